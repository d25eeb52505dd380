//! Which keys of a recipe go together: rules about what is there, whatever its value.
//!
//! In: the tree after [`super::shape`] took out what is wrong. The same list of rivals decides which defaults of
//! `kiln.toml` give way to a recipe's own keys.
//! Unaware of: values, except of the analysis method.

use super::fault::{Fault, Findings, listing};
use super::tree::{At, Entry, Node, Table, Value};
use super::words::{MapFile, Word};

/// Two keys that exclude each other, and why.
const RIVALS: [(&str, &str, &str); 39] = [
    ("mesh", "canvas", "a recipe covers a mesh or fills a canvas; make two recipes"),
    ("canvas", "field", "a canvas has no surface for a field to lie on"),
    ("canvas", "atlas", "a canvas needs no unwrap; its `maps`, `format` and `compression` go into [canvas]"),
    ("canvas", "uv_sets", "a canvas has no vertices to carry texture coordinates"),
    ("canvas", "render", "a canvas is its own picture"),
    ("canvas", "synthesis.scale", "a canvas has no unit of length; its texels are the exemplar's"),
    ("canvas", "synthesis.order", "a canvas has no vertices; `order` in [canvas] is the order of its texels"),
    ("mesh", "exemplar.more", "several samples are mixed on canvases only"),
    ("mesh", "exemplar.mask", "parts of a sample are left out on canvases only"),
    ("mesh", "exemplar.guide", "guides are for canvases"),
    ("canvas.sources", "canvas.guide", "the sources were chosen already; keep one"),
    ("canvas.sources", "canvas.inpaint", "the sources were chosen already; keep one"),
    ("canvas.sources", "canvas.size", "the sources say how large the canvas is"),
    ("canvas.sources", "canvas.tileable", "the sources say whether the canvas wraps"),
    ("canvas.sources", "canvas.order", "the sources were chosen already; nothing is walked"),
    ("canvas.sources", "analysis", "the sources were chosen already; nothing is analysed"),
    ("canvas.sources", "exemplar.importance", "the sources were chosen already; nothing is compared"),
    ("canvas.sources", "exemplar.guide", "the sources were chosen already; nothing is guided"),
    ("canvas.sources", "synthesis.seed", "the sources were chosen already; keep one"),
    ("canvas.sources", "synthesis.patch", "the sources were chosen already; keep one"),
    ("canvas.sources", "synthesis.refine", "the sources were chosen already; nothing is corrected"),
    ("canvas", "synthesis.sharpness", "a canvas is blended by a kernel; `blend_kernel` in [canvas] is its size"),
    ("atlas.size", "atlas.texels_per_unit", "each follows from the other; keep one"),
    ("atlas.unwrap", "atlas.keep_uv", "the texture coordinates are made or kept; keep one"),
    ("atlas.keep_uv", "atlas.texels_per_unit", "kept texture coordinates have their scale already; give `size`"),
    ("atlas.refine", "uv_sets", "the atlas would show what the UV sets cannot; make two recipes"),
    ("atlas.refine", "mesh.lods", "each level's atlas would be corrected for itself, and a switch of levels be seen"),
    ("mesh", "exemplar.frames", "a mesh is covered with a still; a flipbook fills a [canvas]"),
    ("exemplar.frames", "exemplar.base_color", "`frames` are the base colour of a flipbook; keep one"),
    ("exemplar.frames", "exemplar.feature_mask", "a flipbook is analysed without a mask; remove it"),
    ("exemplar.frames", "exemplar.mask", "parts are left out of stills only"),
    ("exemplar.frames", "exemplar.guide", "guides are for stills"),
    ("exemplar.frames", "exemplar.more", "several samples are mixed for stills only"),
    ("exemplar.frames", "canvas.guide", "guides are for stills"),
    ("exemplar.frames", "canvas.inpaint", "holes are filled in stills only"),
    ("exemplar.frames", "canvas.sources", "sources are stored of stills only"),
    ("exemplar.orm", "exemplar.roughness", "`orm` holds the roughness in its green channel; keep one"),
    ("exemplar.orm", "exemplar.metallic", "`orm` holds the metalness in its blue channel; keep one"),
    ("exemplar.orm", "exemplar.occlusion", "`orm` holds the occlusion in its red channel; keep one"),
];

/// Keys that not every method reads, and which do.
const METHOD_KEYS: [(&str, &[&str]); 18] = [
    ("analysis.neighbourhoods", &["jump-map"]),
    ("analysis.jumps", &["jump-map"]),
    ("analysis.variance", &["jump-map"]),
    ("analysis.alpha", &["jump-map"]),
    ("analysis.diversity", &["jump-map"]),
    ("analysis.min_distance", &["jump-map"]),
    ("mesh.lods", &["jump-map", "texton"]),
    ("atlas.refine", &["jump-map", "texton"]),
    ("synthesis.sharpness", &["jump-map"]),
    ("analysis.window", &["texton"]),
    ("analysis.count", &["texton"]),
    ("analysis.features", &["texton"]),
    ("analysis.rotations", &["texton"]),
    ("synthesis.candidates", &["texton"]),
    ("synthesis.blend_threshold", &["texton"]),
    ("analysis.layers", &["material-space"]),
    ("analysis.key", &["material-space"]),
    ("analysis.tile", &["material-space"]),
];

/// Takes out of the defaults what gives way to a recipe's own keys.
pub(super) fn without_rivals(recipe: &Node, defaults: &Table) -> Table {
    let mut kept = defaults.clone();
    for (a, b, _) in RIVALS {
        for (own, rival) in [(a, b), (b, a)] {
            if recipe.entry(own).is_some() {
                remove(&mut kept, rival);
            }
        }
    }
    kept
}

fn remove(table: &mut Table, path: &str) {
    match path.split_once('.') {
        None => _ = table.remove(path),
        Some((first, rest)) => {
            if let Some(inner) = table.get_mut(first).and_then(|entry| entry.node.table_mut()) {
                remove(inner, rest);
            }
        }
    }
}

/// Reports keys that exclude each other.
pub(super) fn check_presence(tree: &Node, findings: &mut Findings) {
    let is_undecided = tree.entry("mesh").is_some() && tree.entry("canvas").is_some();
    for (a, b, why) in RIVALS {
        if is_undecided && (a == "canvas") {
            continue;
        }
        if let (Some(first), Some(second)) = (tree.entry(a), tree.entry(b)) {
            exclusion(findings, (a, first), (b, second), why);
        }
    }
    for_each_table(tree, "render", |path, table| {
        let names = [format!("{path}.view"), format!("{path}.camera")];
        if let (Some(view), Some(camera)) = (table.get("view"), table.get("camera")) {
            let why = "a camera is a view of its own; make two [[render]] tables";
            exclusion(findings, (&names[0], view), (&names[1], camera), why);
        }
    });
    for_each_table(tree, "field.singularities", |path, table| {
        let names = [format!("{path}.kind"), format!("{path}.index")];
        if let (Some(kind), Some(index)) = (table.get("kind"), table.get("index")) {
            exclusion(findings, (&names[0], kind), (&names[1], index), "the kind says the index; keep one");
        }
    });
    let mut check_packed = |path: &str, table: &Table| {
        for packed in ["roughness", "metallic", "occlusion"] {
            if let (Some(orm), Some(single)) = (table.get("orm"), table.get(packed)) {
                let names = [format!("{path}.orm"), format!("{path}.{packed}")];
                exclusion(findings, (&names[0], orm), (&names[1], single), "`orm` holds that map; keep one");
            }
        }
    };
    for_each_table(tree, "exemplar.more", &mut check_packed);
    for_each_table(tree, "analysis.key", &mut check_packed);
    for_each_table(tree, "analysis.key", |path, table| {
        for key in ["mask", "guide"] {
            if let Some(entry) = table.get(key) {
                let message = format!("`{path}.{key}` is for canvases, and a key is part of a tile");
                let fault = Fault::new(entry.key.clone(), format!("{path}.{key}"), message);
                findings.push(fault.hint("remove it".to_string()));
            }
        }
    });
    check_method_keys(tree, findings);
}

/// Reports what is missing, beyond keys that are always required.
pub(super) fn check_absence(tree: &Node, findings: &mut Findings) {
    let has = |key: &str| tree.entry(key).is_some();
    if !has("mesh") && !has("canvas") {
        let hint = "name what to texture: [mesh] with a `path`, or [canvas] with a `size`".to_string();
        let fault = Fault::new(tree.at.clone(), "", "the recipe has neither [mesh] nor [canvas]").hint(hint);
        findings.push_unless_due_to(&["mesh", "canvas"], fault);
    }
    let writes = has("atlas") || has("uv_sets") || has("render") || method(tree) == "material-space";
    if let (Some(mesh), false) = (tree.entry("mesh"), writes) {
        let hint = "add [atlas], [uv_sets] or [[render]]; an empty [atlas] takes the defaults".to_string();
        let fault = Fault::new(mesh.key.clone(), "mesh", "the recipe covers a mesh and writes nothing").hint(hint);
        findings.push_unless_due_to(&["atlas", "uv_sets", "render"], fault);
    }
    if let Some(canvas) = tree.entry("canvas")
        && !["size", "guide", "inpaint", "sources"].iter().any(|key| has(&format!("canvas.{key}")))
    {
        let hint = "write its width and height, such as size = [512, 512]".to_string();
        let fault = Fault::new(canvas.key.clone(), "canvas.size", "[canvas] needs a key `size`").hint(hint);
        findings.push_unless_due_to(&["canvas.size", "canvas.guide", "canvas.inpaint", "canvas.sources"], fault);
    }
    if let Some(exemplar) = tree.entry("exemplar") {
        if let Some(table) = exemplar.node.table() {
            check_maps(findings, &exemplar.key, ("exemplar", "[exemplar]"), table);
        }
        for samples in ["exemplar.more", "analysis.key"] {
            for_each_table(tree, samples, |path, table| {
                check_maps(findings, &tree.locate(path), (path, &format!("`{path}`")), table);
            });
        }
    }
    for_each_table(tree, "field.singularities", |path, table| {
        if !table.contains_key("kind") && !table.contains_key("index") {
            let keys = [format!("{path}.kind"), format!("{path}.index")];
            let fault = Fault::new(tree.locate(path), path, format!("`{path}` has no `kind`"))
                .allowed("kind = \"source\", \"sink\" or \"vortex\", or an `index`");
            findings.push_unless_due_to(&[&keys[0], &keys[1]], fault);
        }
    });
}

/// Reports a sample without any map. The frames of a flipbook are one.
fn check_maps(findings: &mut Findings, at: &At, (path, name): (&str, &str), table: &Table) {
    let names: Vec<&str> = MapFile::ALL.iter().map(|map| map.name()).collect();
    let is_map = |key: &String| names.contains(&key.as_str()) || key == "frames";
    if !table.keys().any(is_map) {
        let fault = Fault::new(at.clone(), path, format!("{name} names no map"))
            .hint(format!("name at least one of {}", listing(&names, "`", "and")));
        let keys: Vec<String> = names.iter().chain(&["frames"]).map(|name| format!("{path}.{name}")).collect();
        findings.push_unless_due_to(&keys.iter().map(String::as_str).collect::<Vec<_>>(), fault);
    }
}

fn exclusion(findings: &mut Findings, a: (&str, &Entry), b: (&str, &Entry), why: &str) {
    let order = |at: &At| (at.source, at.span.start);
    // The later of the two is marked; a default gives way, so it is the recipe's that is marked.
    let ((first, earlier), (second, later)) = if order(&a.1.key) <= order(&b.1.key) { (a, b) } else { (b, a) };
    let message = format!("{} and {} exclude each other", name(first, earlier), name(second, later));
    let fault = Fault::new(later.key.clone(), second, message).found(second).hint(why.to_string());
    findings.push(fault.related(earlier.key.clone(), format!("{} is here", name(first, earlier))));
}

fn name(path: &str, entry: &Entry) -> String {
    match &entry.node.value {
        Value::Table(_) if !path.contains(['.', '[']) => format!("[{path}]"),
        Value::Array(_) if path == "render" => format!("[[{path}]]"),
        Value::Array(_) if path == "exemplar.more" => format!("[[{path}]]"),
        _ => format!("`{path}`"),
    }
}

/// The method that a recipe names, or the default.
fn method(tree: &Node) -> &str {
    match tree.entry("analysis.method").map(|entry| &entry.node.value) {
        Some(Value::String(method)) => method.as_str(),
        _ => "jump-map",
    }
}

fn check_method_keys(tree: &Node, findings: &mut Findings) {
    let method = method(tree);
    for (path, readers) in METHOD_KEYS {
        // Defaults may hold keys for several methods.
        let own = tree.entry(path).filter(|entry| entry.key.source == tree.at.source);
        if let Some(entry) = own.filter(|_| !readers.contains(&method)) {
            let methods = if readers.len() > 1 { "methods" } else { "method" };
            let named = listing(readers, "\"", "and");
            let message = format!("`{path}` belongs to the {methods} {named}, and this recipe's is \"{method}\"");
            let fault = Fault::new(entry.key.clone(), path, message).hint("remove it".to_string());
            findings.push_unless_due_to(&["analysis.method"], fault);
        }
    }
}

/// Visits the tables of an array of tables.
fn for_each_table(tree: &Node, path: &str, mut visit: impl FnMut(&str, &Table)) {
    if let Some(Entry { node: Node { value: Value::Array(items), .. }, .. }) = tree.entry(path) {
        for (i, item) in items.iter().enumerate() {
            if let Some(table) = item.table() {
                visit(&format!("{path}[{i}]"), table);
            }
        }
    }
}
