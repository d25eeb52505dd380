//! `kiln accept`: make outputs golden, all or by name, at once or one by one; take away goldens of what is gone.

use std::io::{BufRead, Write};
use std::path::{Path, PathBuf};

use crate::disk::{Disk, Real};
use crate::golden::book::{Book, Outcome, Output, Verdict, compare_book};
use crate::golden::change::first_change;
use crate::golden::report::{first_step, moved};
use crate::recipe::Recipe;

use super::baked::{Baked, Known};
use super::judge::{Difference, quality};
use super::{failed, recipe_of, shelf};
use crate::cli::args::{Accept, Global};
use crate::cli::bake::build;
use crate::cli::project::{self, OUT};
use crate::cli::{Done, Stop, plan};

/// Makes the present outputs golden.
pub(in crate::cli) fn run(global: &Global, accept: &Accept) -> Result<Done, Stop> {
    if std::env::var_os("CI").is_some_and(|v| !v.is_empty()) && !accept.force {
        let why = "accept does nothing where CI is set: a person looks and accepts; --force overrides";
        return Err(Stop::Usage(why.into()));
    }
    if accept.prune {
        return prune(global);
    }
    let chosen = Chosen::of(&accept.names)?;
    let loaded = project::load(global, &chosen.recipes)?;
    if global.dry_run {
        return plan::show(global, &loaded, false);
    }
    let report = build(global, &loaded)?;
    if !report.is_success() || !loaded.broken.is_empty() {
        return Err(Stop::Failed("nothing was accepted: not everything could be baked".into()));
    }
    let (known, mut text, mut asker) = (Known::of(&report), String::new(), Asker::new(accept.review));
    for planned in &loaded.planned {
        let recipe = recipe_of(&loaded, &planned.name)?;
        let baked = Baked::read(planned, &loaded, &known)?;
        let old = shelf::read_book(&recipe.name)?.unwrap_or_default();
        let all = compare_book(&old, &baked.book);
        let changed: Vec<&Verdict> = all.iter().filter(|v| v.outcome != Outcome::Same).collect();
        let mut accepted: Vec<&str> = Vec::new();
        for verdict in changed.iter().filter(|v| chosen.has(&recipe.name, &v.name)) {
            if asker.ask(recipe, &old, &baked, verdict)? {
                accepted.push(&verdict.name);
            }
        }
        let (is_whole, is_all) = (chosen.is_whole(&recipe.name), accepted.len() == changed.len());
        let is_other = |step: &String| {
            old.step(step).is_some_and(|s| baked.book.step(step).is_some_and(|n| n.artefact != s.artefact))
        };
        if accept.review && changed.is_empty() && baked.analyses.iter().any(is_other) {
            let name = &recipe.name;
            text +=
                &format!("{name}: outputs are as accepted, its analysis is not; to accept it: kiln accept {name}\n");
        }
        // A review that changes nothing writes nothing; without one the rest of the book is brought up to date.
        if !accepted.is_empty() || (is_whole && is_all && !accept.review) {
            shelf::store(recipe, &baked, &old, |name| accepted.contains(&name))?;
        }
        text += &match (is_whole && !accept.review, changed.len() - accepted.len()) {
            (true, _) => {
                format!(
                    "{}: {} outputs accepted, {} of them changed\n",
                    recipe.name,
                    baked.book.outputs.len(),
                    accepted.len()
                )
            }
            (false, 0) if accepted.is_empty() => continue,
            (false, left) => format!("{}: {} changed outputs accepted, {left} left\n", recipe.name, accepted.len()),
        };
    }
    if accept.review && text.is_empty() {
        text = "nothing to review: all outputs are as accepted\n".into();
    }
    if accept.names.is_empty() {
        let stale = shelf::stale()?;
        stale.iter().for_each(|s| text += &format!("stale: {}: {}\n", s.file.display(), s.why));
        if !stale.is_empty() {
            text += "kiln accept --prune removes what is stale\n";
        }
    }
    Done::ok(if global.quiet { String::new() } else { text })
}

/// Removes goldens that belong to nothing, and this machine's copies of what is no longer accepted.
fn prune(global: &Global) -> Result<Done, Stop> {
    let stale = shelf::stale()?;
    let said = if global.dry_run { "would remove" } else { "removed" };
    let mut text = String::new();
    let remove = |file: &Path| match global.dry_run {
        true => Ok(()),
        false => Real.remove(file).map_err(|e| failed(format!("{}: {e}", file.display()))),
    };
    for golden in &stale {
        remove(&golden.file)?;
        text += &format!("{said} {}: {}\n", golden.file.display(), golden.why);
    }
    // Books that went are no reason to keep a copy.
    let copies = shelf::stale_copies()?;
    copies.iter().try_for_each(|file| remove(file))?;
    if !copies.is_empty() {
        text += &format!("{said} {} copies of what is no longer accepted\n", copies.len());
    }
    if text.is_empty() {
        text = "no golden is stale\n".into();
    }
    Done::ok(if global.quiet { String::new() } else { text })
}

/// What was named on the command line.
struct Chosen {
    /// Recipes to load; none means all.
    recipes: Vec<PathBuf>,
    /// Patterns of recipes, and of their outputs where not all are meant.
    patterns: Vec<(String, Option<String>)>,
}

impl Chosen {
    fn of(names: &[String]) -> Result<Chosen, Stop> {
        let mut chosen = Chosen { recipes: Vec::new(), patterns: Vec::new() };
        let files = if names.is_empty() { Vec::new() } else { project::all(&Real)? };
        let known: Vec<(&str, &PathBuf)> = files.iter().filter_map(|f| Some((f.file_stem()?.to_str()?, f))).collect();
        for name in names {
            let matching = |pattern: &str| -> Vec<PathBuf> {
                known.iter().filter(|(recipe, _)| matches(pattern, recipe)).map(|(_, f)| f.to_path_buf()).collect()
            };
            let parts = name.split_once('/').map(|(recipe, output)| (recipe, Some(output.to_string())));
            let (pattern, output) = parts.filter(|_| !name.ends_with(".toml")).unwrap_or((name, None));
            let found = matching(pattern);
            if !found.is_empty() {
                chosen.recipes.extend(found);
                chosen.patterns.push((pattern.to_string(), output));
            } else if name.contains(['*', '?']) {
                let all: Vec<&str> = known.iter().map(|(name, _)| *name).collect();
                return Err(Stop::Usage(format!("`{name}` is no recipe; there are {}", all.join(", "))));
            } else {
                // A recipe's file, or the fault that it is none.
                let stem = Path::new(name).file_stem().and_then(|s| s.to_str()).unwrap_or(name);
                chosen.recipes.push(PathBuf::from(name));
                chosen.patterns.push((stem.to_string(), None));
            }
        }
        chosen.recipes.sort();
        chosen.recipes.dedup();
        Ok(chosen)
    }

    /// Whether an output is meant.
    fn has(&self, recipe: &str, output: &str) -> bool {
        let is_meant =
            |(r, o): &(String, Option<String>)| matches(r, recipe) && o.as_ref().is_none_or(|o| matches(o, output));
        self.patterns.is_empty() || self.patterns.iter().any(is_meant)
    }

    /// Whether all outputs of a recipe are meant.
    fn is_whole(&self, recipe: &str) -> bool {
        self.patterns.is_empty() || self.patterns.iter().any(|(r, o)| o.is_none() && matches(r, recipe))
    }
}

/// Whether a text is as a pattern says: `*` stands for any letters, `?` for one.
fn matches(pattern: &str, text: &str) -> bool {
    let (pattern, text): (Vec<char>, Vec<char>) = (pattern.chars().collect(), text.chars().collect());
    let (mut p, mut t) = (0, 0);
    // Where the last star was, and what it has taken so far.
    let mut star: Option<(usize, usize)> = None;
    while t < text.len() {
        match pattern.get(p) {
            Some('*') => {
                star = Some((p, t));
                p += 1;
            }
            Some(c) if *c == '?' || *c == text[t] => (p, t) = (p + 1, t + 1),
            _ => match star {
                Some((at, taken)) => {
                    (p, t) = (at + 1, taken + 1);
                    star = Some((at, taken + 1));
                }
                None => return false,
            },
        }
    }
    pattern[p..].iter().all(|c| *c == '*')
}

/// Asks about one output after the other.
struct Asker {
    asks: bool,
    /// What was said for everything that follows.
    rest: Option<bool>,
    /// What was said for the rest of a recipe.
    recipe: Option<String>,
}

impl Asker {
    fn new(asks: bool) -> Asker {
        Asker { asks, rest: if asks { None } else { Some(true) }, recipe: None }
    }

    /// Whether a changed output is accepted.
    fn ask(&mut self, recipe: &Recipe, old: &Book, baked: &Baked, verdict: &Verdict) -> Result<bool, Stop> {
        if let Some(answer) = self.rest {
            return Ok(answer);
        }
        if self.recipe.as_ref() == Some(&recipe.name) {
            return Ok(true);
        }
        debug_assert!(self.asks);
        let mut err = anstream::stderr().lock();
        let _ = write!(err, "{}", card(recipe, old, baked, verdict));
        loop {
            let _ = write!(err, "accept? [y]es, [n]o, [a]ll of {}, [q]uit: ", recipe.name);
            let _ = err.flush();
            let mut line = String::new();
            let read = std::io::stdin().lock().read_line(&mut line);
            let read = read.map_err(|e| failed(format!("cannot read the answer: {e}")))?;
            match line.trim() {
                "y" | "yes" => return Ok(true),
                "n" | "no" => return Ok(false),
                "a" | "all" => {
                    self.recipe = Some(recipe.name.clone());
                    return Ok(true);
                }
                // The end of the input is the end of the review.
                "q" | "quit" => self.rest = Some(false),
                _ if read == 0 => self.rest = Some(false),
                other => {
                    let _ = writeln!(err, "`{other}` is none of y, n, a and q");
                    continue;
                }
            }
            let _ = writeln!(err);
            return Ok(false);
        }
    }
}

/// What there is to know about a changed output.
fn card(recipe: &Recipe, old: &Book, baked: &Baked, verdict: &Verdict) -> String {
    let (name, output) = (&recipe.name, &verdict.name);
    let [before, now] = [old, &baked.book].map(|book| book.output(output));
    let shape = |o: &Output| match (o.size, o.channels) {
        (Some([w, h]), Some(c)) => format!("{} {w}x{h}, {c} channel(s), {}", o.kind.name(), &o.blake3[..12]),
        _ => format!("{} {}", o.kind.name(), &o.blake3[..12]),
    };
    let mut text = format!("\n{name}/{output}\n");
    text += &format!("  expected  {}\n", before.map_or("nothing".into(), shape));
    text += &format!("  actual    {}\n", now.map_or("no longer an output".into(), shape));
    let mut say = |lines: &str| lines.lines().for_each(|line| text += &format!("  {line}\n"));
    if let Outcome::Different { expected, actual } = &verdict.outcome {
        say(&Difference::of(name, expected, actual, baked.images.get(output)).said);
    }
    say(&moved(&quality(before, now.map(|o| baked.figures(recipe, o)))).join("\n"));
    if let Some(change) = first_change(old, &baked.book).filter(|_| before.is_some()) {
        say(&first_step(&change));
    }
    if now.is_some() {
        say(&format!("file      {}", Path::new(OUT).join(name).join(output).display()));
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn patterns() {
        for (pattern, text) in
            [("knot", "knot"), ("*", ""), ("k*t", "knot"), ("*no?", "knot"), ("**o*", "knot"), ("a*b*c", "aXbbc")]
        {
            assert!(matches(pattern, text), "{pattern} {text}");
        }
        for (pattern, text) in [("knot", "knots"), ("?", ""), ("k*n", "knot"), ("", "a"), ("a*b*c", "aXcb")] {
            assert!(!matches(pattern, text), "{pattern} {text}");
        }
    }

    #[test]
    fn a_recipe_or_some_of_its_outputs_are_meant() {
        let patterns = vec![("vase".to_string(), Some("render/*".to_string())), ("kn*".to_string(), None)];
        let chosen = Chosen { recipes: vec![], patterns };
        assert!(
            chosen.has("vase", "render/a.png") && !chosen.has("vase", "vase.glb") && chosen.has("knot", "knot.glb")
        );
        assert!(chosen.is_whole("knot") && !chosen.is_whole("vase"));
        let all = Chosen { recipes: vec![], patterns: vec![] };
        assert!(all.has("any", "thing") && all.is_whole("any"));
    }
}
