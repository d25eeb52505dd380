//! Canvases that are steered: several samples, masks, guides, holes, stored sources.

use super::*;

const STEERED: &str = r#"
[canvas]
guide = "target.png"
guide_weight = 2.0
inpaint = "hole.png"

[exemplar]
base_color = "a.png"
roughness = "ar.png"
mask = "am.png"
guide = "ag.png"

[[exemplar.more]]
base_color = "b.png"
roughness = "br.png"
guide = "bg.png"
"#;

const REPLAYED: &str = "canvas.sources = 's.png'\nexemplar.normal = 'n.png'\nsynthesis.blend = 'none'\n";

fn canvas(recipe: &Recipe) -> &Canvas {
    match &recipe.target {
        Target::Canvas(canvas) => canvas,
        Target::Mesh(_) => panic!("a mesh"),
    }
}

#[test]
fn every_key_of_control_arrives() {
    let recipe = read(STEERED).unwrap_or_else(|f| panic!("{f}"));
    let samples = recipe.exemplar.samples();
    let path = |file: &Option<FileRef>| file.as_ref().map(|f| f.path.display().to_string()).unwrap_or_default();
    let files = |s: &Sample| (path(&s.mask), path(&s.guide), s.maps[1].file.path.display().to_string());
    let expected = [("recipes/am.png", "recipes/ag.png", "recipes/ar.png"), ("", "recipes/bg.png", "recipes/br.png")];
    assert_eq!(samples.iter().map(files).collect::<Vec<_>>(), expected.map(|(a, b, c)| (a.into(), b.into(), c.into())));
    assert_eq!(samples[1].maps[0].file.key, "exemplar.more[0].base_color");
    let c = canvas(&recipe);
    assert_eq!((c.size, path(&c.inpaint), path(&c.sources)), (None, "recipes/hole.png".into(), String::new()));
    let guide = c.guide.as_ref().expect("written");
    assert_eq!((guide.weight, guide.file.key.as_str()), (2.0, "canvas.guide"));
    let c = read(REPLAYED).unwrap_or_else(|f| panic!("{f}"));
    assert_eq!((canvas(&c).size, path(&canvas(&c).sources)), (None, "recipes/s.png".into()));
}

#[test]
fn what_does_not_go_together_is_named() {
    let said = |text: &str| faults(text).join("\n");
    for (old, new, expected) in [
        (
            "roughness = \"br.png\"",
            "",
            "13:1: `exemplar.more[0]` has other maps than [exemplar]: expected `base_color` and \
          `roughness`",
        ),
        ("base_color = \"b.png\"\nroughness = \"br.png\"", "", "13:1: `exemplar.more[0]` names no map"),
        (
            "guide = \"bg.png\"",
            "",
            "[exemplar] has a `guide`, and exemplar.more[0] has none; give every sample a guide",
        ),
        ("guide = \"ag.png\"", "", "exemplar.more[0] has a `guide`, and [exemplar] has none"),
        ("guide = \"target.png\"", "", "`canvas.guide_weight` is of no use without `canvas.guide`"),
        (
            "guide = \"target.png\"",
            "",
            "`exemplar.guide` is of no use without `canvas.guide`; add the guide of the canvas",
        ),
        (
            "guide_weight = 2.0",
            "guide_weight = 0",
            "`canvas.guide_weight` can't be 0: expected a number from 0.01 to 100",
        ),
        (
            "guide_weight = 2.0",
            "sources = 's.png'",
            "`canvas.guide` and `canvas.sources` exclude each other; the sources were chosen already; keep one",
        ),
        ("[[exemplar.more]]", "[[exemplar.more]]\nimportance = {}", "unknown key `importance`"),
        ("[[exemplar.more]]", "[[exemplar.more]]\norm = 'o.png'", "exclude each other; `orm` holds that map; keep one"),
    ] {
        let text = STEERED.replacen(old, new, 1);
        assert_ne!(text, STEERED, "{old}");
        assert!(said(&text).contains(expected), "{new}:\n{}", said(&text));
    }
    for (line, expected) in [
        ("canvas.size = [8, 8]", "the sources say how large the canvas is"),
        ("canvas.tileable = true", "the sources say whether the canvas wraps"),
        ("canvas.inpaint = 'h.png'", "the sources were chosen already"),
        ("analysis.jumps = 4", "nothing is analysed"),
        ("synthesis.refine = 1", "nothing is corrected"),
        ("exemplar.guide = 'g.png'", "nothing is guided"),
    ] {
        let found = faults(&format!("{REPLAYED}{line}\n"));
        assert!(found.len() == 1 && found[0].contains(expected), "{line}: {found:#?}");
    }
    let bare = faults("canvas.tileable = true\nexemplar.normal = 'n.png'\n");
    assert_eq!(bare, ["1:1: [canvas] needs a key `size`; write its width and height, such as size = [512, 512]"]);
    for key in ["mask = 'm.png'", "guide = 'g.png'", "more = [{ base_color = 'd.png' }]"] {
        let found = faults(&LEAST.replace("atlas = {}", &format!("atlas = {{}}\nexemplar.{key}")));
        assert!(found[0].contains("exclude each other") && found[0].contains("canvases"), "{found:#?}");
    }
}

#[test]
fn defaults_give_way_to_stored_sources() {
    let project =
        parse_project(Path::new("kiln.toml"), b"[defaults.analysis]\njumps = 5\n[defaults.synthesis]\nseed = 4\n");
    let defaults = project.unwrap_or_else(|f| panic!("{f}")).defaults;
    let recipe = parse(Path::new("recipes/knot.toml"), REPLAYED.as_bytes(), Some(&defaults));
    assert_eq!(recipe.unwrap_or_else(|f| panic!("{f}")).analysis.jumps, 3);
}
