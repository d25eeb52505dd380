//! Polygons of a file cut into triangles.
//!
//! Source: convex polygons as fans from the first corner; others by ear clipping (Meisters 1975) in the plane of their
//! area vector (Newell), ears tried in turn so that the cuts do not all end in one corner.
//! In: corners in space, possibly not quite flat. Out: triangles of corner indices, winding kept; always n - 2 of them.

/// Corners that a concave polygon may have: clipping takes time in their square.
const MAX_CONCAVE: usize = 4096;

/// Triangles of a polygon of `n` corners at `points`, or as a fan if these are not known.
pub(super) fn polygon(n: usize, points: Option<&[[f64; 3]]>) -> Result<Vec<[usize; 3]>, String> {
    let fan = || (1..n - 1).map(|i| [0, i, i + 1]).collect();
    let Some(points) = points.filter(|_| n > 3) else { return Ok(fan()) };
    let flat = flatten(points);
    let turn = |i: usize| cross(flat[(i + n - 1) % n], flat[i], flat[(i + 1) % n]);
    if (0..n).all(|i| turn(i) >= 0.0) {
        return Ok(fan());
    }
    if n > MAX_CONCAVE {
        return Err(format!("a concave polygon of {n} corners; at most {MAX_CONCAVE}"));
    }
    Ok(clip(&flat))
}

/// Coordinates in the plane, such that the polygon's area is not negative.
fn flatten(points: &[[f64; 3]]) -> Vec<[f64; 2]> {
    let mut normal = [0.0_f64; 3];
    for (i, p) in points.iter().enumerate() {
        let q = points[(i + 1) % points.len()];
        for (k, n) in normal.iter_mut().enumerate() {
            let (a, b) = ((k + 1) % 3, (k + 2) % 3);
            *n += (p[a] - q[a]) * (p[b] + q[b]);
        }
    }
    let axis = (0..3).fold(0, |best, k| if normal[k].abs() > normal[best].abs() { k } else { best });
    let (a, b) = ((axis + 1) % 3, (axis + 2) % 3);
    let place = |p: &[f64; 3]| if normal[axis] >= 0.0 { [p[a], p[b]] } else { [p[b], p[a]] };
    points.iter().map(place).collect()
}

/// Twice the signed area of the triangle.
fn cross(a: [f64; 2], b: [f64; 2], c: [f64; 2]) -> f64 {
    (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])
}

fn clip(p: &[[f64; 2]]) -> Vec<[usize; 3]> {
    let mut left: Vec<usize> = (0..p.len()).collect();
    let mut out = Vec::with_capacity(p.len() - 2);
    let mut at = 0;
    while left.len() > 3 {
        let n = left.len();
        let corner = |i: usize| [left[(i + n - 1) % n], left[i % n], left[(i + 1) % n]];
        // A polygon that crosses itself may have no ear: then the flattest corner goes.
        let ear = (0..n).map(|k| (at + k) % n).find(|&i| is_ear(p, &left, corner(i)));
        let i = ear.unwrap_or(at % n);
        out.push(corner(i));
        left.remove(i);
        at = i;
    }
    out.push([left[0], left[1], left[2]]);
    out
}

/// A convex corner whose triangle holds no other corner.
fn is_ear(p: &[[f64; 2]], left: &[usize], [a, b, c]: [usize; 3]) -> bool {
    if cross(p[a], p[b], p[c]) <= 0.0 {
        return false;
    }
    let inside =
        |q: [f64; 2]| cross(p[a], p[b], q) >= 0.0 && cross(p[b], p[c], q) >= 0.0 && cross(p[c], p[a], q) >= 0.0;
    left.iter().all(|&i| i == a || i == b || i == c || [a, b, c].iter().any(|&k| p[k] == p[i]) || !inside(p[i]))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn area(points: &[[f64; 3]], triangles: &[[usize; 3]]) -> f64 {
        triangles.iter().map(|t| cross_xy(points, *t)).map(f64::abs).sum::<f64>() / 2.0
    }

    fn cross_xy(points: &[[f64; 3]], t: [usize; 3]) -> f64 {
        let q = t.map(|i| [points[i][0], points[i][1]]);
        cross(q[0], q[1], q[2])
    }

    #[test]
    fn convex_is_a_fan_and_an_arrow_is_cut_through_its_notch() {
        let square = [[0., 0., 0.], [1., 0., 0.], [1., 1., 0.], [0., 1., 0.]];
        assert_eq!(polygon(4, Some(&square)).unwrap(), [[0, 1, 2], [0, 2, 3]]);
        // The corner at (0.2, 0.2) points inwards: a fan from corner 0 would cover the notch.
        let arrow = [[1., 0., 0.], [0.2, 0.2, 0.], [0., 1., 0.], [0., 0., 0.]];
        for turned in [arrow.to_vec(), arrow.iter().rev().copied().collect()] {
            let t = polygon(4, Some(&turned)).unwrap();
            assert!((area(&turned, &t) - 0.2).abs() < 1e-12, "{t:?}");
        }
    }

    #[test]
    fn a_comb_keeps_its_area_and_winding() {
        // Teeth of width one and height two on a bar of height one.
        let mut comb = vec![[0., 0., 0.]];
        comb.push([19., 0., 0.]);
        for i in (0..10).rev() {
            let x = f64::from(2 * i);
            comb.extend([[x + 1., 3., 0.], [x, 3., 0.]]);
            if i > 0 {
                comb.extend([[x, 1., 0.], [x - 1., 1., 0.]]);
            }
        }
        let t = polygon(comb.len(), Some(&comb)).unwrap();
        assert_eq!(t.len(), comb.len() - 2);
        assert!((area(&comb, &t) - 39.0).abs() < 1e-9);
        assert!(t.iter().all(|&t| cross_xy(&comb, t) > -1e-12));
        let mut huge = comb.clone();
        huge.extend(vec![[0., 2., 0.]; MAX_CONCAVE]);
        assert!(polygon(huge.len(), Some(&huge)).is_err());
    }
}
