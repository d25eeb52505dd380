//! What can be typed: verbs, flags and their values.
//!
//! In: the command line. Out: checked values; a mistake ends with exit code 2 and a sentence, by clap.
//! Unaware of: what the verbs do.

use super::synth_inputs::Control;
use crate::recipe::{self, Blend, BlendSize, CanvasDebug, CanvasOrder, RemoteMode, Word, limits};
use clap::builder::{PossibleValuesParser, TypedValueParser, ValueParser};
use clap::{ArgAction, Args, Parser, Subcommand, ValueEnum, ValueHint};
use std::num::NonZeroUsize;
use std::ops::RangeInclusive;
use std::path::PathBuf;
use std::time::Duration;

/// The command line.
#[derive(Clone, Debug, Parser)]
#[command(
    name = "kiln",
    version,
    about = "Bakes textures onto meshes from small samples",
    after_help = "\
Examples:
  kiln init statue.glb moss/ > recipes/statue.toml
  kiln bake
  kiln check --report report.html

Exit codes: 0 done or up to date, 1 a bake or a golden failed, 2 the command or a recipe is wrong, 130 interrupted.",
    subcommand_required = true,
    arg_required_else_help = true,
    disable_help_subcommand = true
)]
pub struct Cli {
    /// Flags of every verb.
    #[command(flatten)]
    pub global: Global,
    /// What to do.
    #[command(subcommand)]
    pub verb: Verb,
}

/// Flags of every verb.
#[derive(Clone, Debug, Args)]
#[command(next_help_heading = "Common options")]
pub struct Global {
    /// Work in this folder
    #[arg(short = 'C', long = "directory", value_name = "DIR", global = true, value_hint = ValueHint::DirPath)]
    pub directory: Option<PathBuf>,
    /// Run so many threads; default: one per core. Outputs do not depend on it
    #[arg(short, long, value_name = "N", global = true, value_parser = threads)]
    pub jobs: Option<NonZeroUsize>,
    /// Run steps side by side only while they fit into so much memory, such as 8GiB; default: three quarters of the
    /// machine's
    #[arg(long, value_name = "SIZE", global = true, value_parser = bytes)]
    pub memory: Option<u64>,
    /// Keep what steps gave in this folder; default: what kiln.toml says, else .kiln/cache
    #[arg(long, value_name = "DIR", global = true, value_hint = ValueHint::DirPath)]
    pub cache: Option<PathBuf>,
    /// Ask this server for what is not there, such as grpc://farm:8980; default: what kiln.toml says. "none": nobody
    #[arg(long, value_name = "URL", global = true, value_parser = server)]
    pub remote: Option<String>,
    /// Whether results from here are stored on the server, too; default: what kiln.toml says, else read-write
    #[arg(long, value_name = "MODE", global = true, value_parser = word::<RemoteMode>())]
    pub remote_mode: Option<RemoteMode>,
    /// Have long steps done by the server's workers
    #[arg(long, global = true)]
    pub remote_execute: bool,
    /// Keep going when a recipe fails or is wrong
    #[arg(short, long, global = true)]
    pub keep_going: bool,
    /// Say what would be done, and do nothing
    #[arg(short = 'n', long, global = true)]
    pub dry_run: bool,
    /// Say nothing but results and errors
    #[arg(short, long, global = true, conflicts_with = "verbose")]
    pub quiet: bool,
    /// Say more; twice: still more
    #[arg(short, long, global = true, action = ArgAction::Count)]
    pub verbose: u8,
    /// Say of each step why it runs
    #[arg(long, global = true)]
    pub explain: bool,
    /// Form of the results on standard output
    #[arg(long, value_name = "FORM", global = true, value_enum, default_value_t = Format::Text)]
    pub format: Format,
    /// Colours in messages
    #[arg(long, value_name = "WHEN", global = true, value_enum, default_value_t = Color::Auto)]
    pub color: Color,
    /// Write a Chrome trace of the run, for Perfetto
    #[arg(long, value_name = "FILE", global = true, value_hint = ValueHint::FilePath)]
    pub trace: Option<PathBuf>,
    /// Write the outputs and their inputs as a rule for Make and Ninja
    #[arg(long, value_name = "FILE", global = true, value_hint = ValueHint::FilePath)]
    pub depfile: Option<PathBuf>,
}

/// Form of the results.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum Format {
    /// For people
    Text,
    /// For programs
    Json,
    /// As rules for Ninja, one per recipe; only of a plan
    Ninja,
}

/// When messages are coloured.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum Color {
    /// On a terminal, unless NO_COLOR is set
    Auto,
    /// Always
    Always,
    /// Never
    Never,
}

/// What to do.
#[derive(Clone, Debug, Subcommand)]
pub enum Verb {
    /// Bring outputs up to date
    #[command(after_help = "\
Examples:
  kiln bake                            everything in recipes/
  kiln bake recipes/statue.toml -j 4   one recipe, four threads
  kiln bake -n --explain               what would run, and why
  kiln bake --prune                    also remove the outputs of removed recipes")]
    Bake(Bake),
    /// Bake whenever something changes, until Ctrl-C
    #[command(after_help = "\
Example:
  kiln watch statue")]
    Watch(Recipes),
    /// Bake, then compare with golden/
    #[command(after_help = "\
Examples:
  kiln check
  kiln check --report report.html --junit report.xml
  kiln check --twice                   is every step the same in another process with other threads?")]
    Check(Check),
    /// Make the present outputs golden
    #[command(after_help = "\
Examples:
  kiln accept statue
  kiln accept 'statue*' 'vase/render/*'
  kiln accept --review                 look at what changed, one by one
  kiln accept --prune -n               which goldens belong to nothing any more
  kiln accept                          every recipe")]
    Accept(Accept),
    /// Show what would run and why
    #[command(after_help = "\
Examples:
  kiln plan
  kiln plan recipes/statue.toml --format json
  kiln plan --graph | dot -Tsvg > graph.svg
  kiln plan --format ninja > kiln.ninja")]
    Plan(Plan),
    /// Make a flat texture without a recipe
    #[command(after_help = "\
Examples:
  kiln synth moss.png -o large-moss.png --size 1024x1024
  kiln synth bricks.png -o wall.exr --size 2048x512 --seed 7 --neighbourhoods 13,9,5 --blend none
  kiln synth moss.png -o part.png --size 16384x16384 --tileable --region 8000,0,512,512 --debug patches=patches.png
  kiln synth moss.png lichen.png -o both.png --size 512x512 --mask 2=usable.png
  kiln synth rust.png -o plate.png --exemplar-guide rust-labels.png --guide painted-labels.png
  kiln synth wall.png -o mended.png --inpaint hole.png
  kiln synth moss.png --seamless -o moss-wraps.png --debug sources=moss-wraps.sources.png
  kiln synth rough.png --map roughness -o large-rough.png --sources large-moss.sources.png")]
    Synth(Box<Synth>),
    /// Write a commented recipe to start from
    #[command(after_help = "\
Examples:
  kiln init statue.glb moss/ > recipes/statue.toml
  kiln init statue.glb moss/color.png moss/normal.png -o recipes/statue.toml")]
    Init(Init),
    /// Show what is in a mesh, an exemplar, an analysis or a bake
    #[command(after_help = "\
Examples:
  kiln inspect moss.png
  kiln inspect moss.png --texton-map textons.png
  kiln inspect moss.png --feature-mask features.png
  kiln inspect statue.glb
  kiln inspect out/statue/statue.glb --format json")]
    Inspect(Inspect),
    /// Show, verify, trim, copy or clear the cache
    #[command(after_help = "\
Examples:
  kiln cache size
  kiln cache verify
  kiln cache trim --max-size 20GiB --max-age 30d
  kiln cache export for-the-farm")]
    Cache(Cache),
    /// Do one step of a recipe, as a worker: reads ./order and ./inputs, writes ./artefact
    #[command(hide = true, after_help = "Example:\n  kiln step KEY")]
    Step(Step),
    /// Print the JSON Schema of recipes, for editors
    #[command(after_help = "\
Example:
  kiln schema > kiln.schema.json       then begin recipes with: #:schema ../kiln.schema.json")]
    Schema,
    /// Print the shader that blends UV sets
    #[command(after_help = "\
Example:
  kiln shader glsl > kiln_uv_sets.glsl")]
    Shader(Shader),
    /// Print completions for a shell
    #[command(after_help = "\
Example:
  kiln completions bash > ~/.local/share/bash-completion/completions/kiln")]
    Completions(Completions),
}

/// `kiln bake`.
#[derive(Clone, Debug, Args)]
pub struct Bake {
    /// What to bake.
    #[command(flatten)]
    pub recipes: Recipes,
    /// Remove the outputs of recipes that are gone, as far as nobody else has changed them
    #[arg(long, conflicts_with = "recipes")]
    pub prune: bool,
}

/// Recipes to work on.
#[derive(Clone, Debug, Args)]
pub struct Recipes {
    /// Recipes; default: all of recipes/
    #[arg(value_name = "RECIPE", value_hint = ValueHint::FilePath)]
    pub recipes: Vec<PathBuf>,
}

/// `kiln check`.
#[derive(Clone, Debug, Args)]
pub struct Check {
    /// What to check.
    #[command(flatten)]
    pub recipes: Recipes,
    /// Write a page to look through: expected, difference and actual, figures, what moved
    #[arg(long, value_name = "FILE.html", value_hint = ValueHint::FilePath)]
    pub report: Option<PathBuf>,
    /// Write the results as JUnit XML
    #[arg(long, value_name = "FILE.xml", value_hint = ValueHint::FilePath)]
    pub junit: Option<PathBuf>,
    /// Bake every step again in a fresh process with another number of threads, and compare each artefact
    #[arg(long)]
    pub twice: bool,
    /// Bake every step apart from the outputs and the cache, and write the names of the artefacts (of --twice)
    #[arg(long, value_name = "FILE", hide = true)]
    pub artefacts: Option<PathBuf>,
}

/// `kiln accept`.
#[derive(Clone, Debug, Args)]
pub struct Accept {
    /// Recipes, or outputs as RECIPE/OUTPUT; * and ? stand for anything. Default: all
    #[arg(value_name = "NAME")]
    pub names: Vec<String>,
    /// Show each output that changed and ask
    #[arg(long)]
    pub review: bool,
    /// Accept nothing; remove goldens that belong to no recipe or output
    #[arg(long, conflicts_with_all = ["review", "names"])]
    pub prune: bool,
    /// Accept even where CI is set
    #[arg(long)]
    pub force: bool,
}

/// `kiln plan`.
#[derive(Clone, Debug, Args)]
pub struct Plan {
    /// What to plan.
    #[command(flatten)]
    pub recipes: Recipes,
    /// Print the graph of steps as DOT
    #[arg(long)]
    pub graph: bool,
}

/// `kiln synth`. What is left out has the recipe's default.
#[derive(Clone, Debug, Args)]
pub struct Synth {
    /// The sample, or several: the output is mixed of all
    #[arg(value_name = "EXEMPLAR", required = true, value_hint = ValueHint::FilePath)]
    pub exemplars: Vec<PathBuf>,
    /// File to write; its extension says the format
    #[arg(short, long, value_name = "OUT", value_hint = ValueHint::FilePath)]
    pub output: PathBuf,
    /// Width and height in texels; may be left out where --guide, --inpaint or --sources says it
    #[arg(long, value_name = "WxH", value_parser = size, required_unless_present_any = ["guide", "inpaint", "sources", "seamless"])]
    pub size: Option<Size>,
    /// Make only this window of it: first column and row, width and height
    #[arg(long, value_name = "X,Y,W,H", value_parser = region)]
    pub region: Option<Region>,
    /// The output wraps in both directions
    #[arg(long)]
    pub tileable: bool,
    /// Make the sample itself wrap, in its own size, by a cut through copies of it. Nothing is analysed; other maps of it
    /// follow by --sources and what --debug sources=FILE.png wrote
    #[arg(long, conflicts_with_all = ["size", "region", "tileable", "seed", "order", "patch", "neighbourhoods", "refine",
                                      "mask", "guide", "inpaint", "sources"])]
    pub seamless: bool,
    /// Another seed gives another texture of the same kind [default: 1]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u64).range(limits::SEED))]
    pub seed: Option<u64>,
    /// Order in which texels are made [default: hilbert]
    #[arg(long, value_parser = word::<CanvasOrder>())]
    pub order: Option<CanvasOrder>,
    /// Mean distance between jumps, in exemplar sides [default: 1.0]
    #[arg(long, value_name = "SIDES", value_parser = patch)]
    pub patch: Option<f64>,
    /// Sides of the neighbourhoods in texels, finest level first [default: 9,5,3]
    #[arg(long, value_name = "N,N,..", value_parser = neighbourhoods)]
    pub neighbourhoods: Option<Neighbourhoods>,
    /// How patches meet: linear or none [default: linear]
    #[arg(long, value_parser = word::<Blend>())]
    pub blend: Option<Blend>,
    /// Side in texels of the kernel that blends patches: 3 or 5 [default: 3]
    #[arg(long, value_name = "N", value_parser = PossibleValuesParser::new(["3", "5"]).map(|n| if n == "5" { BlendSize::Five } else { BlendSize::Three }))]
    pub blend_kernel: Option<BlendSize>,
    /// Write a picture of how it came about, such as patches=FILE.png: patches (place in the sample as a colour), sources
    /// (that place as numbers of 16 bits) or jumps (where patches begin). May be repeated
    #[arg(long, value_name = "WHAT=FILE.png", value_parser = debug_picture)]
    pub debug: Vec<DebugPicture>,
    /// Correction passes; 0 is the published method [default: 2]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(i64::from(*limits::REFINE.start())..=i64::from(*limits::REFINE.end())))]
    pub refine: Option<u32>,
    /// What steers it.
    #[command(flatten)]
    pub control: Control,
}

/// Width and height in texels.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Size {
    /// Texels per row.
    pub width: u32,
    /// Rows.
    pub height: u32,
}

/// A window of the output.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Region {
    /// First column.
    pub x: u32,
    /// First row.
    pub y: u32,
    /// Columns, at least 1.
    pub width: u32,
    /// Rows, at least 1.
    pub height: u32,
}

/// A picture of how an output came about, and its file.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct DebugPicture {
    /// What it shows.
    pub what: CanvasDebug,
    /// A .png.
    pub file: PathBuf,
}

/// Sides of neighbourhoods in texels, odd, finest level first; at least one.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Neighbourhoods(pub Vec<u32>);

/// `kiln init`.
#[derive(Clone, Debug, Args)]
pub struct Init {
    /// The mesh
    #[arg(value_name = "MESH", value_hint = ValueHint::FilePath)]
    pub mesh: PathBuf,
    /// The sample: its maps, or the folder that holds them
    #[arg(value_name = "EXEMPLAR", required = true, value_hint = ValueHint::AnyPath)]
    pub exemplar: Vec<PathBuf>,
    /// File to write; default: standard output
    #[arg(short, long, value_name = "FILE.toml", value_hint = ValueHint::FilePath)]
    pub output: Option<PathBuf>,
}

/// `kiln inspect`.
#[derive(Clone, Debug, Args)]
pub struct Inspect {
    /// A mesh, a picture, a bake, or a jump map or field from the cache
    #[arg(value_name = "FILE", value_hint = ValueHint::FilePath)]
    pub file: PathBuf,
    /// Only what a picture's file says, not what an analysis of it finds
    #[arg(long)]
    pub quick: bool,
    /// Write the textons of a picture as a PNG: one colour for texels whose surroundings look alike
    #[arg(long, value_name = "OUT.png", value_hint = ValueHint::FilePath)]
    pub texton_map: Option<PathBuf>,
    /// Write where a picture's features are found as a PNG: white in them, black between. Made to wrap first, as a key of a
    /// tile is
    #[arg(long, value_name = "OUT.png", value_hint = ValueHint::FilePath)]
    pub feature_mask: Option<PathBuf>,
}

/// `kiln cache`.
#[derive(Clone, Debug, Args)]
pub struct Cache {
    /// What to do with it.
    #[command(subcommand)]
    pub what: Option<CacheVerb>,
}

/// What to do with the cache; `size` when nothing is said.
#[derive(Clone, Debug, PartialEq, Eq, Subcommand)]
pub enum CacheVerb {
    /// Show where it is and how large
    #[command(after_help = "Example:\n  kiln cache size")]
    Size,
    /// Check every entry; damaged ones are removed and built anew when needed
    #[command(after_help = "Example:\n  kiln cache verify")]
    Verify,
    /// Remove what was not used for longest; what the outputs here are made from goes last
    #[command(after_help = "Examples:\n  kiln cache trim\n  kiln cache trim --max-size 20GiB --max-age 30d")]
    Trim {
        /// Until it has at most so many bytes; default: `max_size` of kiln.toml
        #[arg(long, value_name = "SIZE", value_parser = bytes)]
        max_size: Option<u64>,
        /// Whatever was not used for so long, such as 30d or 12h
        #[arg(long, value_name = "AGE", value_parser = age)]
        max_age: Option<Duration>,
    },
    /// Copy what the outputs here are made from to a folder, which is a cache itself
    #[command(after_help = "Example:\n  kiln cache export for-the-farm")]
    Export {
        /// The folder
        #[arg(value_name = "FOLDER", value_hint = ValueHint::DirPath)]
        folder: PathBuf,
        /// Copy everything there is
        #[arg(long)]
        all: bool,
    },
    /// Copy a folder that was exported into the cache; every entry is checked
    #[command(after_help = "Example:\n  kiln cache import for-the-farm")]
    Import {
        /// The folder
        #[arg(value_name = "FOLDER", value_hint = ValueHint::DirPath)]
        folder: PathBuf,
    },
    /// Remove every entry
    #[command(after_help = "Example:\n  kiln cache clear")]
    Clear,
}

/// `kiln step`.
#[derive(Clone, Debug, Args)]
pub struct Step {
    /// Key of the step, in hexadecimal.
    pub key: String,
}

/// `kiln shader`.
#[derive(Clone, Copy, Debug, Args)]
pub struct Shader {
    /// Language
    #[arg(value_enum)]
    pub language: ShaderLanguage,
}

/// Languages of the shader.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum ShaderLanguage {
    /// GLSL ES 3.00
    Glsl,
    /// WGSL
    Wgsl,
    /// JavaScript that patches a three.js material
    Three,
}

/// `kiln completions`.
#[derive(Clone, Copy, Debug, Args)]
pub struct Completions {
    /// Shell
    #[arg(value_enum)]
    pub shell: clap_complete::Shell,
}

/// A word of the recipe format.
pub(super) fn word<W: Word>() -> ValueParser {
    let names = PossibleValuesParser::new(W::ALL.iter().map(|word| word.name()));
    names.try_map(|name| W::from_name(&name).ok_or("not a word of the list")).into()
}

pub(super) fn within<T: PartialOrd + std::fmt::Display>(value: T, range: RangeInclusive<T>) -> Result<T, String> {
    if range.contains(&value) { Ok(value) } else { Err(format!("expected {} to {}", range.start(), range.end())) }
}

/// More threads than any machine has would only fail later.
const MOST_THREADS: usize = 1024;

fn threads(text: &str) -> Result<NonZeroUsize, String> {
    let range = || format!("expected a whole number from 1 to {MOST_THREADS}");
    text.parse().ok().filter(|n: &NonZeroUsize| n.get() <= MOST_THREADS).ok_or_else(range)
}

/// A number with a unit: one of `units`, each with how many it stands for.
fn measure(text: &str, units: &[(&str, u64)], form: &str) -> Result<u64, String> {
    let form = || format!("expected {form}");
    let (unit, factor) = units.iter().find(|(unit, _)| text.ends_with(unit)).ok_or_else(form)?;
    let number: u64 = text[..text.len() - unit.len()].trim_end().parse().map_err(|_| form())?;
    number.checked_mul(*factor).ok_or_else(form)
}

fn server(text: &str) -> Result<String, String> {
    let form = || "expected grpc://host:port, grpcs://host:port or none".to_string();
    if text == "none" || recipe::is_address(text) { Ok(text.to_string()) } else { Err(form()) }
}

fn bytes(text: &str) -> Result<u64, String> {
    let units = [("KiB", 1 << 10), ("MiB", 1 << 20), ("GiB", 1 << 30), ("TiB", 1 << 40), ("B", 1)];
    measure(text, &units, "a whole number and B, KiB, MiB, GiB or TiB, such as 8GiB")
}

fn age(text: &str) -> Result<Duration, String> {
    let units = [("d", 86_400), ("h", 3600), ("m", 60), ("s", 1)];
    measure(text, &units, "a whole number and d, h, m or s, such as 30d").map(Duration::from_secs)
}

fn size(text: &str) -> Result<Size, String> {
    let form = || "expected WIDTHxHEIGHT, such as 1024x512".to_string();
    let (width, height) = text.split_once(['x', 'X']).ok_or_else(form)?;
    let side = |text: &str| within(text.parse::<u32>().map_err(|_| form())?, limits::CANVAS_SIDE);
    Ok(Size { width: side(width)?, height: side(height)? })
}

fn region(text: &str) -> Result<Region, String> {
    let form = || "expected X,Y,WIDTH,HEIGHT, such as 0,512,256,256".to_string();
    let numbers = text.split(',').map(|n| n.trim().parse().map_err(|_| form())).collect::<Result<Vec<u32>, _>>()?;
    match numbers[..] {
        [x, y, width, height] if width > 0 && height > 0 => Ok(Region { x, y, width, height }),
        _ => Err(form()),
    }
}

fn debug_picture(text: &str) -> Result<DebugPicture, String> {
    let form = || {
        let names: Vec<&str> = CanvasDebug::ALL.iter().map(|word| word.name()).collect();
        format!("expected one of {}, then = and a .png file, such as patches=patches.png", names.join(", "))
    };
    let (what, file) = text.split_once('=').ok_or_else(form)?;
    let (what, file) = (CanvasDebug::from_name(what).ok_or_else(form)?, PathBuf::from(file));
    let is_png = file.extension().is_some_and(|e| e.eq_ignore_ascii_case("png"));
    if is_png { Ok(DebugPicture { what, file }) } else { Err(form()) }
}

fn patch(text: &str) -> Result<f64, String> {
    within(text.parse().map_err(|_| "expected a number, such as 1.0")?, limits::PATCH)
}

fn neighbourhoods(text: &str) -> Result<Neighbourhoods, String> {
    let side = |text: &str| {
        let side = text.trim().parse().map_err(|_| "expected odd whole numbers, such as 9,5,3")?;
        if side % 2 == 0 { Err(format!("{side} is even; a neighbourhood has a centre")) } else { Ok(side) }
    };
    let sides =
        text.split(',').map(|text| within(side(text)?, limits::NEIGHBOURHOOD)).collect::<Result<Vec<_>, _>>()?;
    let levels = limits::LEVELS;
    match sides.len() {
        n if levels.contains(&n) => Ok(Neighbourhoods(sides)),
        n => Err(format!("{n} levels; expected {} to {}", levels.start(), levels.end())),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::recipe::MapFile;
    use clap::CommandFactory;

    fn read(line: &str) -> Result<Cli, String> {
        Cli::try_parse_from(line.split(' ')).map_err(|e| {
            assert_eq!(e.exit_code(), 2, "{line}");
            e.to_string()
        })
    }

    fn synth(flags: &str) -> Result<Synth, String> {
        match read(&format!("kiln synth a.png -o b.png {flags}"))?.verb {
            Verb::Synth(synth) => Ok(*synth),
            other => panic!("{other:?}"),
        }
    }

    #[test]
    fn the_command_line_is_sound_and_every_verb_has_an_example() {
        Cli::command().debug_assert();
        fn check(command: &clap::Command) {
            let help = command.get_after_help().map(|help| help.to_string()).unwrap_or_default();
            assert!(help.contains("Example") && help.contains("kiln "), "{} has no example", command.get_name());
            command.get_subcommands().for_each(check);
        }
        check(&Cli::command());
    }

    #[test]
    fn the_examples_of_the_help_are_right() {
        let verbs = Cli::command().get_subcommands().cloned().collect::<Vec<_>>();
        for command in verbs.iter().chain([&Cli::command()]) {
            for line in command.get_after_help().map(|help| help.to_string()).unwrap_or_default().lines() {
                if let Some(example) = line.strip_prefix("  ").filter(|line| line.starts_with("kiln ")) {
                    let example =
                        example.split("  ").next().and_then(|e| e.split(['>', '|']).next()).unwrap_or_default();
                    assert!(read(example.trim()).is_ok(), "{example}: {:?}", read(example.trim()));
                }
            }
        }
    }

    #[test]
    fn global_flags_stand_before_or_after_the_verb() {
        for line in
            ["kiln -C x -j 3 -k -n -vv --color never bake a.toml", "kiln bake a.toml -kn -vv -j3 -Cx --color=never"]
        {
            let cli = read(line).unwrap_or_else(|e| panic!("{e}"));
            let g = cli.global;
            assert_eq!((g.directory, g.jobs.map(NonZeroUsize::get), g.verbose), (Some("x".into()), Some(3), 2));
            assert!(g.keep_going && g.dry_run && !g.quiet && !g.explain);
            assert_eq!((g.color, g.format), (Color::Never, Format::Text));
            assert!(matches!(cli.verb, Verb::Bake(bake) if bake.recipes.recipes == [PathBuf::from("a.toml")]));
        }
        for wrong in [
            "kiln bake -j 0",
            "kiln bake -j -1",
            "kiln bake -j 9999",
            "kiln bake -q -v",
            "kiln",
            "kiln bak",
            "kiln bake a.toml --prune",
            "kiln bake --memory 8",
            "kiln bake --remote farm:8980",
            "kiln bake --remote-mode write",
            "kiln cache trim --max-age 5y",
            "kiln cache trim --max-size -1B",
            "kiln cache trim --max-size 99999999TiB",
            "kiln plan --format xml",
            "kiln shader hlsl",
            "kiln synth a.png --size 1x1",
        ] {
            assert!(read(wrong).is_err(), "{wrong}");
        }
        assert!(read("kiln bak").is_err_and(|e| e.contains("'bake'")));
    }

    #[test]
    fn measures_have_units() {
        let trim = |line: &str| match read(line).map(|cli| cli.verb) {
            Ok(Verb::Cache(Cache { what: Some(CacheVerb::Trim { max_size, max_age }) })) => (max_size, max_age),
            other => panic!("{other:?}"),
        };
        let (size, age) = trim("kiln cache trim --max-size 3MiB --max-age 2d");
        assert_eq!((size, age), (Some(3 << 20), Some(Duration::from_secs(172_800))));
        assert_eq!(trim("kiln cache trim --max-size 7B --max-age 5m"), (Some(7), Some(Duration::from_secs(300))));
        assert_eq!(read("kiln bake --memory 2GiB").map(|cli| cli.global.memory), Ok(Some(2 << 30)));
    }

    #[test]
    fn sizes_are_checked_before_memory_is_taken() {
        assert_eq!(synth("--size 640x480").map(|s| s.size), Ok(Some(Size { width: 640, height: 480 })));
        for (size, said) in [
            ("640", "expected WIDTHxHEIGHT"),
            ("640x", "expected WIDTHxHEIGHT"),
            ("-1x5", "expected WIDTHxHEIGHT"),
            ("0x5", "expected 1 to 16384"),
            ("16385x5", "expected 1 to 16384"),
            ("99999999999x1", "expected WIDTHxHEIGHT"),
        ] {
            assert!(synth(&format!("--size={size}")).is_err_and(|e| e.contains(said)), "{size}");
        }
    }

    #[test]
    fn regions_and_pictures_are_read_whole_or_not_at_all() {
        let s = synth(
            "--size 90x90 --tileable --region 1,2,30,4 --blend-kernel 5 --debug jumps=j.PNG --debug patches=p.png",
        );
        let s = s.unwrap_or_else(|e| panic!("{e}"));
        assert_eq!(s.region, Some(Region { x: 1, y: 2, width: 30, height: 4 }));
        assert_eq!((s.tileable, s.blend_kernel), (true, Some(BlendSize::Five)));
        let what: Vec<_> = s.debug.iter().map(|d| (d.what, d.file.to_str())).collect();
        assert_eq!(what, [(CanvasDebug::Jumps, Some("j.PNG")), (CanvasDebug::Patches, Some("p.png"))]);
        for (flag, said) in [
            ("--region 1,2,3", "expected X,Y,WIDTH,HEIGHT"),
            ("--region 1,2,0,3", "expected X,Y,WIDTH,HEIGHT"),
            ("--region 1,2,-5,3", "expected X,Y,WIDTH,HEIGHT"),
            ("--debug patches", "such as patches=patches.png"),
            ("--debug patch=a.png", "patches, sources, jumps"),
            ("--debug sources=a.exr", "a .png file"),
            ("--blend-kernel 4", "3, 5"),
        ] {
            assert!(synth(&format!("--size 8x8 {flag}")).is_err_and(|e| e.contains(said)), "{flag}: {:?}", synth(flag));
        }
    }

    #[test]
    fn the_size_may_follow_from_what_steers() {
        assert!(synth("--tileable").is_err_and(|e| e.contains("--size")));
        let s = synth("b.png c.png --guide g.png --guide-weight 2 --mask 2=m.png").unwrap_or_else(|e| panic!("{e}"));
        assert_eq!((s.exemplars.len(), s.size, s.control.guide_weight), (3, None, Some(2.0)));
        assert_eq!(s.control.mask[0].number, Some(2));
        let s = synth("--sources s.png --map normal").unwrap_or_else(|e| panic!("{e}"));
        assert_eq!(s.control.map, Some(MapFile::Normal));
        for (flags, said) in [
            ("--sources s.png --guide g.png", "cannot be used with"),
            ("--sources s.png --size 8x8", "cannot be used with"),
            ("--sources s.png --refine 1", "cannot be used with"),
            ("--inpaint i.png --region 0,0,5,5", "cannot be used with"),
            ("--size 8x8 --exemplar-guide g.png", "--guide <TARGET>"),
            ("--guide g.png --guide-weight 0", "expected 0.01 to 100"),
            ("--size 8x8 --mask 0=m.png", "counted from 1"),
            ("--size 8x8 --map colour", "base_color"),
        ] {
            assert!(synth(flags).is_err_and(|e| e.contains(said)), "{flags}: {:?}", synth(flags));
        }
    }

    #[test]
    fn values_are_those_of_recipes() {
        let all = "--size 8x8 --seed 7 --order scanline --patch 1.5 --neighbourhoods 9,5 --blend variance";
        let s = synth(all).unwrap_or_else(|e| panic!("{e}"));
        assert_eq!((s.seed, s.order, s.patch), (Some(7), Some(CanvasOrder::Scanline), Some(1.5)));
        assert_eq!((s.neighbourhoods, s.blend), (Some(Neighbourhoods(vec![9, 5])), Some(Blend::Variance)));
        for (flag, said) in [
            ("--patch nan", "expected 0.01 to 100"),
            ("--patch 0", "expected 0.01 to 100"),
            ("--neighbourhoods 9,4", "4 is even"),
            ("--neighbourhoods 35", "expected 1 to 33"),
            ("--neighbourhoods 3,3,3,3,3,3,3,3,3", "9 levels; expected 1 to 8"),
            ("--neighbourhoods ,", "expected odd whole numbers"),
            ("--blend lineer", "'linear'"),
            ("--order up", "hilbert"),
            ("--seed -1", ""),
        ] {
            assert!(synth(&format!("--size 8x8 {flag}")).is_err_and(|e| e.contains(said)), "{flag}: {:?}", synth(flag));
        }
    }
}
