//! A number per vertex from values at a few points: harmonic between them.
//!
//! Source: `[MST09]` 2.1 (constraints with effect areas); here for the local scale, which is interpolated in its
//! logarithm so that it stays positive and doubling and halving weigh alike.

use std::collections::BTreeMap;

use super::relax::{Coupling, Guide, Pin, cotangent_weights, disc, relax};
use super::{Error, Which, site};
use crate::mesh::{Topology, TriMesh, check};
use crate::numerics::csr::{Complex, complex};
use crate::numerics::det;
use crate::numerics::par;
use crate::numerics::vec::Vec3;

/// A value at a point of the surface.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ScalarConstraint {
    /// Acts at the point of the surface nearest to this.
    pub at: Vec3,
    /// The value there.
    pub value: f64,
    /// Acts only within this geodesic distance (along edges), in world units; `None`: on the whole component.
    pub radius: Option<f64>,
}

/// What a component has that no constraint without a radius sits on.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Elsewhere {
    /// This value.
    Value(f64),
    /// The mean of the values without a radius, each by the inverse square of its distance in a straight line (Shepard
    /// 1968), so that parts which do not touch vary together; this value if all have a radius.
    Around(f64),
}

/// Interpolates values over the surface. A component without a constraint without radius has what `elsewhere` says, but
/// within the radius of those with. Every value lies between the least and the greatest of those given and that.
/// `list` names the constraints in errors.
pub fn interpolate(
    mesh: &TriMesh,
    topo: &Topology,
    list: &'static str,
    constraints: &[ScalarConstraint],
    elsewhere: Elsewhere,
) -> Result<Vec<f64>, Error> {
    let n = topo.vertex_count();
    let (Elsewhere::Value(default) | Elsewhere::Around(default)) = elsewhere;
    if constraints.is_empty() {
        return Ok(vec![default; n]);
    }
    let which = |index| Which { list, index };
    if let Some(i) = constraints.iter().position(|c| !c.value.is_finite()) {
        return Err(Error::NotFinite(which(i)));
    }
    let wanted: Vec<_> = constraints.iter().enumerate().map(|(i, c)| (which(i), c.at, c.radius)).collect();
    let sites = site::sites(mesh, &wanted)?;
    refuse_contradictions(mesh, &sites, constraints, which)?;

    let ones = vec![Complex::ONE; topo.half_edge_count()];
    let coupling = Coupling { weights: cotangent_weights(mesh, topo), transport: ones };
    let pin = |(s, c): (&site::Site, &ScalarConstraint)| disc(mesh, topo, &coupling, s, complex(c.value, 0.0));
    let pins: Vec<Pin> = sites.iter().zip(constraints).map(pin).collect();
    let (labels, ruled) = ruled(topo, &sites);
    let free: Vec<bool> = labels.iter().map(|&l| ruled[l as usize]).collect();
    let everywhere: Vec<_> = constraints.iter().filter(|c| c.radius.is_none()).collect();
    let around = elsewhere == Elsewhere::Around(default) && !everywhere.is_empty();
    let mut z = par::map(n, |v| match around && !free[v] {
        true => complex(mean_around(mesh.positions[v], &everywhere), 0.0),
        false => complex(default, 0.0),
    });
    let guide = vec![Guide::default(); n];
    relax(mesh, topo, &coupling, &pins, &free, [&guide, &guide], &mut z);

    // Harmonic values lie between those given; the solver's error must not change that.
    let (low, high) = constraints.iter().fold((default, default), |(l, h), c| (l.min(c.value), h.max(c.value)));
    Ok(z.iter().map(|z| z.re.clamp(low, high)).collect())
}

/// The component of each vertex, and whether a place without radius lies on it, per component.
fn ruled(topo: &Topology, sites: &[site::Site]) -> (Vec<u32>, Vec<bool>) {
    let (labels, count) = check::components(topo);
    let mut ruled = vec![false; count];
    sites.iter().filter(|s| s.radius.is_none()).for_each(|s| ruled[labels[s.vertex as usize] as usize] = true);
    (labels, ruled)
}

/// Number of components with faces that no constraint without a radius sits on.
pub fn components_without(
    mesh: &TriMesh,
    topo: &Topology,
    list: &'static str,
    constraints: &[ScalarConstraint],
) -> Result<usize, Error> {
    let wanted = constraints.iter().enumerate().map(|(index, c)| (Which { list, index }, c.at, c.radius));
    let sites = site::sites(mesh, &wanted.collect::<Vec<_>>())?;
    let (labels, ruled) = ruled(topo, &sites);
    let mut faces = vec![false; ruled.len()];
    mesh.faces.iter().for_each(|f| faces[labels[f[0] as usize] as usize] = true);
    Ok(faces.iter().zip(&ruled).filter(|(faces, ruled)| **faces && !**ruled).count())
}

/// The mean of values by the inverse square of their distance.
fn mean_around(at: Vec3, constraints: &[&ScalarConstraint]) -> f64 {
    let (mut sum, mut weights) = (0.0, 0.0);
    for c in constraints {
        let away = c.at - at;
        let weight = 1.0 / away.dot(away).max(f64::MIN_POSITIVE);
        // Where the point itself lies, nothing else counts.
        if weight > 1e300 {
            return c.value;
        }
        sum += weight * c.value;
        weights += weight;
    }
    sum / weights
}

/// Refuses two values at one vertex, both with or both without a radius.
fn refuse_contradictions(
    mesh: &TriMesh,
    sites: &[site::Site],
    constraints: &[ScalarConstraint],
    which: impl Fn(usize) -> Which,
) -> Result<(), Error> {
    let mut known: BTreeMap<(u32, bool), usize> = BTreeMap::new();
    for (i, s) in sites.iter().enumerate() {
        let first = *known.entry((s.vertex, s.radius.is_some())).or_insert(i);
        if constraints[first].value != constraints[i].value {
            let at = mesh.positions[s.vertex as usize];
            return Err(Error::Contradiction { first: which(first), second: which(i), at });
        }
    }
    Ok(())
}

/// The scale at each vertex in texels per world unit: `mean` times the local factors (0.001..=1000), interpolated in
/// their logarithms; 1 where there is no constraint.
pub fn scale(mesh: &TriMesh, topo: &Topology, mean: f64, factors: &[ScalarConstraint]) -> Result<Vec<f32>, Error> {
    if !(1e-30..=1e30).contains(&mean) {
        return Err(Error::Scale(mean));
    }
    let mut logs = vec![];
    for (index, c) in factors.iter().enumerate() {
        if !(1e-3..=1e3).contains(&c.value) {
            return Err(Error::Factor { which: Which { list: "scale", index }, factor: c.value });
        }
        logs.push(ScalarConstraint { value: det::ln(c.value), ..*c });
    }
    let logs = interpolate(mesh, topo, "scale", &logs, Elsewhere::Value(0.0))?;
    Ok(logs.iter().map(|&l| (mean * det::exp(l)) as f32).collect())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::zoo;
    use crate::numerics::vec::vec3;

    fn at(x: f64, y: f64, value: f64, radius: Option<f64>) -> ScalarConstraint {
        ScalarConstraint { at: vec3(x, y, 0.0), value, radius }
    }

    #[test]
    fn without_constraints_or_with_one_it_is_constant() {
        for (name, m) in zoo::all() {
            let topo = Topology::new(&m);
            assert!(scale(&m, &topo, 5.0, &[]).unwrap().iter().all(|&s| s == 5.0), "{name}");
            let one = ScalarConstraint { at: m.positions[0], value: 2.0, radius: None };
            let s = scale(&m, &topo, 5.0, &[one]).unwrap();
            let (labels, _) = check::components(&topo);
            for (v, s) in s.iter().enumerate() {
                let want = if labels[v] == labels[0] { 10.0 } else { 5.0 };
                assert!((s - want).abs() < 1e-5, "{name}: {s} at {v}");
            }
        }
    }

    #[test]
    fn between_two_factors_it_is_their_mean_by_symmetry_and_never_beyond() {
        let m = zoo::plane(40, 40);
        let c = [at(5.0, 20.0, 0.25, None), at(35.0, 20.0, 4.0, None)];
        let s = scale(&m, &Topology::new(&m), 1.0, &c).unwrap();
        let get = |x: usize, y: usize| s[y * 41 + x];
        assert!((get(20, 20) - 1.0).abs() < 0.02, "{}", get(20, 20));
        assert_eq!((get(5, 20), get(35, 20)), (0.25, 4.0));
        assert!((5..35).all(|x| get(x, 20) <= get(x + 1, 20)), "monotone");
        assert!(s.iter().all(|s| (0.25..=4.0).contains(s)));
        assert!(get(10, 20) < 0.8 && get(30, 20) > 1.25, "the disc carries some way: {}", get(10, 20));
    }

    #[test]
    fn a_radius_ends_the_influence() {
        let m = zoo::plane(40, 10);
        let topo = Topology::new(&m);
        let s = scale(&m, &topo, 3.0, &[at(10.0, 5.0, 2.0, Some(6.0))]).unwrap();
        assert_eq!(s[5 * 41 + 10], 6.0);
        assert!((3.01..5.99).contains(&s[5 * 41 + 13]));
        assert!((17..=40).all(|x| s[5 * 41 + x] == 3.0));
        // The same within the reach of another that rules everywhere.
        let s = scale(&m, &topo, 3.0, &[at(10.0, 5.0, 2.0, Some(6.0)), at(30.0, 5.0, 0.5, None)]).unwrap();
        assert!((17..=40).all(|x| (s[5 * 41 + x] - 1.5).abs() < 1e-5));
        assert_eq!(s[5 * 41 + 10], 6.0);
    }

    #[test]
    fn a_component_without_a_word_of_its_own_goes_by_what_is_around() {
        // Three planes beside each other; the outer ones have constraints.
        let mut m = zoo::plane(4, 4);
        let (one, n) = (m.clone(), m.positions.len());
        for k in 1..3u32 {
            m.positions.extend(one.positions.iter().map(|p| vec3(p.x + 10.0 * f64::from(k), p.y, p.z)));
            m.faces.extend(one.faces.iter().map(|f| f.map(|v| v + k * n as u32)));
        }
        m.positions.push(vec3(0., 0., 9.));
        let topo = Topology::new(&m);
        let c = [at(2., 2., 0.2, None), at(22., 2., 0.6, None), at(12., 2., 0.9, Some(1.5))];
        let run = |c: &[ScalarConstraint], e| interpolate(&m, &topo, "material", c, e).unwrap();
        let (around, value) = (run(&c, Elsewhere::Around(0.0)), run(&c, Elsewhere::Value(0.0)));
        assert!((0..n).all(|v| around[v] == value[v] && (around[v] - 0.2).abs() < 1e-6));
        let middle = |v: usize| around[n + v];
        // At (12, 4), as far from one as from the other, and beyond the third one's radius.
        assert!((middle(22) - 0.4).abs() < 1e-12 && (middle(12) - 0.9).abs() < 1e-12, "{}", middle(22));
        assert!(value[n + 22] == 0.0 && around[n] < 0.4 && around[n + 4] > 0.4);
        assert_eq!(components_without(&m, &topo, "material", &c), Ok(1));
        assert_eq!(components_without(&m, &topo, "material", &c[2..]), Ok(3));
        assert!(run(&c[2..], Elsewhere::Around(0.5))[..n].iter().all(|&m| m == 0.5));
    }

    #[test]
    fn bad_factors_are_named() {
        let m = zoo::plane(2, 2);
        let topo = Topology::new(&m);
        for value in [0.0, -2.0, f64::NAN, 1e9] {
            let e = scale(&m, &topo, 1.0, &[at(0., 0., 1.0, None), at(0., 0., value, None)]).unwrap_err();
            assert!(e.to_string().starts_with("scale constraint 1: the factor is"), "{e}");
        }
        let e = scale(&m, &topo, 1.0, &[at(0., 0., 1.0, None), at(0.1, 0., 2.0, None)]).unwrap_err();
        assert!(e.to_string().starts_with("scale constraint 0 and scale constraint 1 contradict"), "{e}");
        assert!(scale(&m, &topo, 1.0, &[at(0., 0., 1.0, None), at(0., 0., 2.0, Some(0.5))]).is_ok());
        assert!(matches!(scale(&m, &topo, f64::NAN, &[]), Err(Error::Scale(_))));
        assert!(matches!(
            interpolate(&m, &topo, "material", &[at(0., 0., f64::NAN, None)], Elsewhere::Value(0.0)),
            Err(Error::NotFinite(_))
        ));
    }
}
