//! The node tree: checked, and turned into world transforms and the node that shows each mesh first.
//!
//! Source: glTF 2.0, 3.5 (scenes, nodes, transformations) and 3.7.3 (a skinned mesh ignores its node's transform).
//! Reads as: "first" is the order of a walk from the roots of the default scene (or the first), children in order;
//! nodes outside it come after, by index.

use serde_json::Value;

use super::refs::{index, list};
use crate::io::SceneError;
use crate::numerics::vec::{Vec3, vec3};

/// Upper three rows of an affine matrix.
pub(super) type Matrix = [[f64; 4]; 3];

pub(super) const IDENTITY: Matrix = [[1.0, 0.0, 0.0, 0.0], [0.0, 1.0, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0]];

/// `a * b`.
fn product(a: &Matrix, b: &Matrix) -> Matrix {
    std::array::from_fn(|r| {
        std::array::from_fn(|c| {
            let sum = a[r][0] * b[0][c] + a[r][1] * b[1][c] + a[r][2] * b[2][c];
            if c == 3 { sum + a[r][3] } else { sum }
        })
    })
}

/// The linear part's action on points, normals and tangents, both ways.
#[derive(Clone, Copy, Debug)]
pub(super) struct Linear {
    rows: [Vec3; 3],
    cofactors: [Vec3; 3],
    determinant: f64,
}

impl Linear {
    pub(super) fn new(m: &Matrix) -> Self {
        let rows = m.map(|r| vec3(r[0], r[1], r[2]));
        let cofactors = [rows[1].cross(rows[2]), rows[2].cross(rows[0]), rows[0].cross(rows[1])];
        Linear { rows, cofactors, determinant: rows[0].dot(cofactors[0]) }
    }

    /// Whether the transform turns the winding of triangles round.
    pub(super) fn mirrors(&self) -> bool {
        self.determinant < 0.0
    }

    fn apply(rows: &[Vec3; 3], v: Vec3) -> Vec3 {
        vec3(rows[0].dot(v), rows[1].dot(v), rows[2].dot(v))
    }

    fn apply_transposed(rows: &[Vec3; 3], v: Vec3) -> Vec3 {
        rows[0] * v.x + rows[1] * v.y + rows[2] * v.z
    }

    /// Direction in the world of an object's normal; `None` where it vanishes.
    pub(super) fn normal_to_world(&self, n: Vec3) -> Option<Vec3> {
        let sign = if self.mirrors() { -1.0 } else { 1.0 };
        (Self::apply(&self.cofactors, n) * sign).normalized()
    }

    /// The inverse of [`Linear::normal_to_world`].
    pub(super) fn normal_to_object(&self, n: Vec3) -> Option<Vec3> {
        Self::apply_transposed(&self.rows, n).normalized()
    }

    /// Direction in the object of a tangent in the world.
    pub(super) fn tangent_to_object(&self, t: Vec3) -> Option<Vec3> {
        let sign = if self.mirrors() { -1.0 } else { 1.0 };
        (Self::apply_transposed(&self.cofactors, t) * sign).normalized()
    }
}

/// A point under a transform.
pub(super) fn transform(m: &Matrix, p: Vec3) -> Vec3 {
    let row = |r: &[f64; 4]| r[0] * p.x + r[1] * p.y + r[2] * p.z + r[3];
    vec3(row(&m[0]), row(&m[1]), row(&m[2]))
}

fn numbers<const N: usize>(node: &Value, key: &str, path: &str) -> Result<Option<[f64; N]>, SceneError> {
    let Some(value) = node.get(key).filter(|v| !v.is_null()) else { return Ok(None) };
    let all: Vec<f64> = value.as_array().into_iter().flatten().filter_map(Value::as_f64).collect();
    match <[f64; N]>::try_from(all) {
        Ok(a) if a.iter().all(|v| v.abs() <= f64::from(f32::MAX)) => Ok(Some(a)),
        _ => Err(SceneError::at(format!("{path}.{key}"), format!("found {value}, expected {N} finite numbers"))),
    }
}

fn local(node: &Value, path: &str) -> Result<Matrix, SceneError> {
    let translation = numbers::<3>(node, "translation", path)?;
    let rotation = numbers::<4>(node, "rotation", path)?;
    let scale = numbers::<3>(node, "scale", path)?;
    if let Some(m) = numbers::<16>(node, "matrix", path)? {
        if translation.is_some() || rotation.is_some() || scale.is_some() {
            return Err(SceneError::at(
                path,
                "both `matrix` and translation, rotation or scale; expected one of the two",
            ));
        }
        if [m[3], m[7], m[11]].iter().any(|v| v.abs() > 1e-6) || (m[15] - 1.0).abs() > 1e-6 {
            return Err(SceneError::at(format!("{path}.matrix"), "the last row is not 0, 0, 0, 1"));
        }
        return Ok(std::array::from_fn(|r| std::array::from_fn(|c| m[4 * c + r])));
    }
    let [x, y, z, w] = rotation.unwrap_or([0.0, 0.0, 0.0, 1.0]);
    let length = (x * x + y * y + z * z + w * w).sqrt();
    if (length - 1.0).abs() > 1e-2 {
        let what = format!("a quaternion of length {length}, expected 1");
        return Err(SceneError::at(format!("{path}.rotation"), what));
    }
    let rotation = [
        [1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y - z * w), 2.0 * (x * z + y * w)],
        [2.0 * (x * y + z * w), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z - x * w)],
        [2.0 * (x * z - y * w), 2.0 * (y * z + x * w), 1.0 - 2.0 * (x * x + y * y)],
    ];
    let (s, t) = (scale.unwrap_or([1.0; 3]), translation.unwrap_or([0.0; 3]));
    Ok(std::array::from_fn(|r| [rotation[r][0] * s[0], rotation[r][1] * s[1], rotation[r][2] * s[2], t[r]]))
}

/// Parent of each node. Every node has at most one and none is above itself.
fn parents(nodes: &[Value]) -> Result<Vec<Option<usize>>, SceneError> {
    let mut parents: Vec<Option<usize>> = vec![None; nodes.len()];
    for (i, node) in nodes.iter().enumerate() {
        for (k, child) in list(node, "children").iter().enumerate().filter_map(|(k, c)| Some((k, c.as_u64()? as usize)))
        {
            let path = format!("nodes[{i}].children[{k}]");
            if child == i {
                return Err(SceneError::at(path, format!("node {i} is its own child")));
            }
            if let Some(first) = parents[child].replace(i) {
                return Err(SceneError::at(path, format!("node {child} is a child of node {first} already")));
            }
        }
    }
    // Walking up from a node ends at a root or at a node seen earlier, unless it comes back to this very walk.
    let mut walk = vec![usize::MAX; nodes.len()];
    for start in 0..nodes.len() {
        let mut at = start;
        while walk[at] == usize::MAX {
            walk[at] = start;
            let Some(up) = parents[at] else { break };
            if walk[up] == start {
                return Err(SceneError::at(format!("nodes[{up}]"), "the node is its own ancestor"));
            }
            at = up;
        }
    }
    Ok(parents)
}

/// For each mesh the transform of the node that shows it first; `None` for a mesh that no node shows.
///
/// A document without any node that shows a mesh shows all of them where they are.
pub(super) fn first_shown(root: &Value) -> Result<Vec<Option<Matrix>>, SceneError> {
    let nodes = list(root, "nodes");
    let parents = parents(nodes)?;
    let mut world: Vec<Option<Matrix>> = vec![None; nodes.len()];
    let mut visited = vec![false; nodes.len()];
    let mut shown: Vec<Option<Matrix>> = vec![None; list(root, "meshes").len()];
    let scene = list(root, "scenes").get(index(root, "scene").unwrap_or(0));
    let in_scene = scene.into_iter().flat_map(|s| list(s, "nodes")).filter_map(|n| n.as_u64().map(|n| n as usize));
    let outside = (0..nodes.len()).filter(|&n| parents[n].is_none());
    for start in in_scene.chain(outside) {
        let mut stack = vec![start];
        while let Some(n) = stack.pop() {
            if std::mem::replace(&mut visited[n], true) {
                continue;
            }
            let m = world_matrix(nodes, &parents, &mut world, n)?;
            if let Some(mesh) = index(&nodes[n], "mesh") {
                let skinned = index(&nodes[n], "skin").is_some();
                shown[mesh].get_or_insert(if skinned { IDENTITY } else { m });
            }
            stack.extend(list(&nodes[n], "children").iter().rev().filter_map(|c| c.as_u64().map(|c| c as usize)));
        }
    }
    if shown.iter().all(Option::is_none) {
        shown.fill(Some(IDENTITY));
    }
    Ok(shown)
}

/// The transform of a node in the world; those of its ancestors are kept on the way.
fn world_matrix(
    nodes: &[Value],
    parents: &[Option<usize>],
    world: &mut [Option<Matrix>],
    n: usize,
) -> Result<Matrix, SceneError> {
    let mut chain = vec![n];
    while let Some(p) = parents[chain[chain.len() - 1]].filter(|&p| world[p].is_none()) {
        chain.push(p);
    }
    let mut m = parents[chain[chain.len() - 1]].and_then(|p| world[p]).unwrap_or(IDENTITY);
    for &k in chain.iter().rev() {
        m = product(&m, &local(&nodes[k], &format!("nodes[{k}]"))?);
        if !m.as_flattened().iter().all(|v| v.is_finite()) {
            return Err(SceneError::at(format!("nodes[{k}]"), "the transform in the world is not finite"));
        }
        world[k] = Some(m);
    }
    Ok(m)
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde_json::json;

    #[test]
    fn transforms_nest_and_the_first_in_the_scene_wins() {
        let half = std::f64::consts::FRAC_1_SQRT_2;
        let root = json!({
            "meshes": [{}, {}, {}],
            "scenes": [{"nodes": [2]}],
            "nodes": [
                {"mesh": 0, "translation": [9, 9, 9]},
                {"mesh": 0, "translation": [1, 0, 0]},
                {"children": [1, 3], "rotation": [0, 0, half, half], "scale": [2, 2, 2]},
                {"mesh": 1, "skin": 0, "scale": [5, 5, 5]},
            ],
        });
        let shown = first_shown(&root).unwrap();
        let p = transform(&shown[0].unwrap(), vec3(0.0, 1.0, 0.0));
        assert!((p - vec3(-2.0, 2.0, 0.0)).length() < 1e-12, "{p:?}");
        assert_eq!(shown[1], Some(IDENTITY));
        assert_eq!(shown[2], None);
    }

    #[test]
    fn faults_of_the_tree() {
        let fault = |nodes: Value| first_shown(&json!({"nodes": nodes})).unwrap_err().to_string();
        assert!(fault(json!([{"children": [1]}, {"children": [0]}])).contains("its own ancestor"));
        assert!(fault(json!([{"children": [0]}])).contains("own child"));
        assert!(fault(json!([{"children": [2]}, {"children": [2]}, {}])).contains("child of node 0 already"));
        assert!(fault(json!([{"scale": [1, 2]}])).contains("3 finite numbers"));
        assert!(fault(json!([{"rotation": [0, 0, 0, 0]}])).contains("length 0"));
        assert!(fault(json!([{"matrix": [1], "scale": [1, 1, 1]}])).contains("16"));
        // A long chain is no recursion; its scales overflow.
        let chain: Vec<Value> = (1..100_000).map(|i| json!({"children": [i], "scale": [10, 10, 10]})).collect();
        assert!(fault(Value::Array([chain, vec![json!({})]].concat())).contains("not finite"));
    }

    #[test]
    fn normals_and_tangents_turn_back() {
        let m: Matrix = [[-2.0, 0.5, 0.0, 7.0], [0.0, 1.0, 0.3, 8.0], [0.1, 0.0, 3.0, 9.0]];
        let l = Linear::new(&m);
        assert!(l.mirrors());
        let n = vec3(1.0, 2.0, 3.0).normalized().unwrap();
        let back = l.normal_to_object(l.normal_to_world(n).unwrap()).unwrap();
        assert!((back - n).length() < 1e-12);
        let moved = (transform(&m, n) - transform(&m, Vec3::ZERO)).normalized().unwrap();
        assert!((l.tangent_to_object(moved).unwrap() - n).length() < 1e-12);
    }
}
