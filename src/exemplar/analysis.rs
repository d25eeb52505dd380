//! The analysis phase: from the maps of a sample to its jump map.
//!
//! Source: \[ZG02\] section 2, figure 2 line by line; Eq. 1-3; diversity by Poisson disc, section 2.2.
//! In: maps w x h, parameters. Out: a jump map of w x h rows of at most k jumps, and a report.
//! Reads as: Eq. 2 is printed with k + 1 terms; taken as k (test `row_weights_sum_to_at_most_one`). d is the L2 norm
//! in the space of the principal components, D its maximum over the jumps that were accepted. k in Eq. 1 is the
//! parameter, also for texels with fewer jumps. If D = 0 every jump is perfect, p = 1/k. Eq. 3, the running sums, is left
//! to the walk, which scales the row first.
//! Unaware of: meshes, files, recipes.

use super::matching::{Grid, matches};
use super::neighbourhood::Neighbourhoods;
use super::{AnalysisParams, Error, Jump, JumpMap};
use crate::numerics::knn::{self, Neighbours, Points};
use crate::numerics::rng::Key;
use crate::numerics::{par, pca};
use crate::texture::MapSet;

/// Texels whose vectors are used to find the principal components.
const SAMPLES: usize = 4096;

/// What an analysis found.
#[derive(Clone, Debug, PartialEq)]
pub struct AnalysisReport {
    /// Components of a neighbourhood vector.
    pub dimensions: usize,
    /// Components kept.
    pub kept_dimensions: usize,
    /// Share of the variance that they hold, 0..=1.
    pub kept_variance: f64,
    /// Least distance of jumps, texels.
    pub min_distance: f64,
    /// Largest distance of a jump's two neighbourhoods, D of \[ZG02\] Eq. 1.
    pub max_distance: f64,
    /// Mean distance of a jump's two neighbourhoods.
    pub mean_distance: f64,
    /// Mean number of jumps per texel.
    pub mean_jumps: f64,
    /// Texels without any jump.
    pub jumpless: usize,
}

/// Finds for every texel up to k texels with similar neighbourhoods and the probabilities of jumping there.
///
/// The result is the same for any number of threads. Maps without importance take no part. Probabilities are whole
/// multiples of 2^-16, rounded down, at least 2^-16. Source: \[ZG02\] section 2.
/// Fails if a parameter is out of range, the exemplar is smaller than its finest neighbourhood or too large, or a value
/// is not a finite number of reasonable size.
pub fn analyse(maps: &MapSet, params: &AnalysisParams) -> Result<(JumpMap, AnalysisReport), Error> {
    let Prepared { points, grid, pca, dimensions } = prepare(maps, params)?;
    let found = matches(&points, grid, params.matches());
    let accepted = par::map(points.len(), |i| accept(grid, &found, i as u32, params));

    let count: usize = accepted.iter().map(Vec::len).sum();
    let largest = accepted.iter().flatten().map(|m| m.1).max().unwrap_or(0);
    // In index order, so that the sum is the same for any number of threads.
    let total: f64 = accepted.iter().flatten().map(|m| points.length(m.1)).sum();
    let report = AnalysisReport {
        dimensions,
        kept_dimensions: pca.basis.len(),
        kept_variance: pca.kept_variance,
        min_distance: grid.min_distance,
        max_distance: points.length(largest),
        mean_distance: total / count.max(1) as f64,
        mean_jumps: count as f64 / points.len() as f64,
        jumpless: accepted.iter().filter(|a| a.is_empty()).count(),
    };
    let rows = par::map(points.len(), |i| row(grid, &points, &accepted[i], params, report.max_distance));
    Ok((JumpMap::from_rows(maps.width(), maps.height(), &rows), report))
}

/// Share of the beta k best matches that the search behind [`analyse`] finds, 0..=1, measured against comparing with
/// all texels at `sample_count` texels (at least one). A match as good as the worst of the true ones counts.
/// Fails as `analyse` does.
pub fn recall(maps: &MapSet, params: &AnalysisParams, sample_count: usize) -> Result<f64, Error> {
    let Prepared { points, grid, .. } = prepare(maps, params)?;
    let found = matches(&points, grid, params.matches());
    let key = Key::new(0).with_str("recall");
    let counts = par::map_chunks(sample_count.max(1), 1, |r| {
        let texel = key.below(r.start as u64, points.len() as u32);
        let truth = knn::exhaustive(&points, texel, params.matches(), |a, b| grid.apart(a, b));
        let worst = truth.last().map_or(0, |m| m.1);
        let hits = found.row(texel).take(truth.len()).filter(|m| m.1 <= worst).count();
        (hits, truth.len())
    });
    let (hits, all) = counts.iter().fold((0, 0), |s, c| (s.0 + c.0, s.1 + c.1));
    Ok(if all == 0 { 1.0 } else { hits as f64 / all as f64 })
}

/// The exemplar as the search wants it.
struct Prepared {
    points: Points,
    grid: Grid,
    pca: pca::Pca,
    dimensions: usize,
}

/// Checks, then pyramid, neighbourhood vectors, principal components.
fn prepare(maps: &MapSet, params: &AnalysisParams) -> Result<Prepared, Error> {
    params.check(maps)?;
    let vectors = Neighbourhoods::new(maps, params);
    let dimensions = vectors.dims();
    let pca = pca::fit(&vectors.sample(SAMPLES.max(4 * dimensions)), dimensions, params.variance, dimensions);
    params.check_memory(maps, pca.basis.len())?;
    let grid = Grid {
        width: maps.width(),
        height: maps.height(),
        wrap: params.wrap,
        min_distance: params.resolved_min_distance(maps),
    };
    Ok(Prepared { points: vectors.project(&pca), grid, pca, dimensions })
}

/// Poisson-disc filter: of a texel's best beta k matches, best first, those that keep their distance from the accepted
/// ones, up to k. They all keep it from the texel. Source: \[ZG02\] 2.2.
fn accept(grid: Grid, found: &Neighbours, texel: u32, params: &AnalysisParams) -> Vec<(u32, u32)> {
    let mut accepted: Vec<(u32, u32)> = Vec::with_capacity(params.jumps as usize);
    for (candidate, squared) in found.row(texel).take(params.matches()) {
        if accepted.len() == params.jumps as usize {
            break;
        }
        if accepted.iter().all(|a| grid.apart(a.0, candidate)) {
            accepted.push((candidate, squared));
        }
    }
    accepted
}

/// The jumps to accepted matches. Source: \[ZG02\] Eq. 1.
fn row(grid: Grid, points: &Points, accepted: &[(u32, u32)], params: &AnalysisParams, largest: f64) -> Vec<Jump> {
    const STEPS: f64 = 65536.0;
    let (k, t) = (f64::from(params.jumps), params.alpha * largest);
    let jump = |&(to, squared): &(u32, u32)| {
        let p = if t > 0.0 { (t - points.length(squared)) / (k * t) } else { 1.0 / k };
        let p = (p * STEPS).floor().max(1.0) / STEPS;
        Jump { x: (to % grid.width) as u16, y: (to / grid.width) as u16, p: p as f32 }
    };
    accepted.iter().map(jump).collect()
}
