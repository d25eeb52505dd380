//! The analysis phase: from the maps of a sample to its jump map.
//!
//! Source: \[ZG02\] section 2, figure 2 line by line; Eq. 1-3; diversity by Poisson disc, section 2.2.
//! In: maps w x h and which of their texels may be copied, parameters. Out: a jump map of w x h rows of at most k jumps,
//! empty for other texels, and a report.
//! Reads as: Eq. 2 is printed with k + 1 terms; taken as k (test `row_weights_sum_to_at_most_one`). d is the L2 norm
//! in the space of the principal components, D its maximum over the jumps that were accepted. k in Eq. 1 is the
//! parameter, also for texels with fewer jumps. If D = 0 every jump is perfect, p = 1/k. Probabilities are rounded down to
//! 256 steps of 1/k, so that they are a byte on disk and the same when read back. Eq. 3, the running sums, is left to the
//! walk, which scales the row first.
//! Unaware of: meshes, files, recipes.

use super::matching::{Grid, matches};
use super::neighbourhood::Neighbourhoods;
use super::sheet::Subject;
use super::{AnalysisParams, Error, Jump, JumpMap, Sheet};
use crate::numerics::knn::{self, Neighbours, Points};
use crate::numerics::rng::Key;
use crate::numerics::{par, pca};
use crate::texture::MapSet;

/// Texels whose vectors are used to find the principal components.
const SAMPLES: usize = 2048;

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
/// multiples of 2^-16, at least one. Source: \[ZG02\] section 2.
/// Fails if a parameter is out of range, the exemplar is smaller than its finest neighbourhood or too large, or a value
/// is not a finite number of reasonable size.
pub fn analyse(maps: &MapSet, params: &AnalysisParams) -> Result<(JumpMap, AnalysisReport), Error> {
    analyse_subject(&Subject::sample(maps, params)?, params, 0).map(|(map, report, _)| (map, report))
}

/// As [`analyse`], for several samples and parts of samples: jumps lead from any texel of the domain to any other.
/// Fails moreover if the masks leave no neighbourhood whole, or several samples shall wrap.
pub fn analyse_sheet(sheet: &Sheet, params: &AnalysisParams) -> Result<(JumpMap, AnalysisReport), Error> {
    analyse_subject(&Subject::sheet(sheet, params)?, params, 0).map(|(map, report, _)| (map, report))
}

/// As [`analyse`], and the share of the beta k best matches that the search found, 0..=1, measured against comparing with
/// all texels at `sample_count` texels (at least one). A match as good as the worst of the true ones counts.
pub fn analyse_measured(
    maps: &MapSet,
    params: &AnalysisParams,
    sample_count: usize,
) -> Result<(JumpMap, AnalysisReport, f64), Error> {
    analyse_subject(&Subject::sample(maps, params)?, params, sample_count.max(1))
}

/// The recall is 1 without samples.
fn analyse_subject(
    subject: &Subject,
    params: &AnalysisParams,
    sample_count: usize,
) -> Result<(JumpMap, AnalysisReport, f64), Error> {
    let Prepared { points, grid, pca, dimensions } = prepare(subject, params)?;
    let found = matches(&points, &grid, params.matches());
    let recall = recall(&points, &grid, &found, params.matches(), sample_count);
    let accepted = Accepted::new(&grid, &found, points.len(), params);
    drop(found);

    let largest = accepted.matches.iter().map(|m| m.1).max().unwrap_or(0);
    // In index order, so that the sum is the same for any number of threads.
    let total: f64 = accepted.matches.iter().map(|m| points.length(m.1)).sum();
    let count = accepted.matches.len();
    let report = AnalysisReport {
        dimensions,
        kept_dimensions: pca.basis.len(),
        kept_variance: pca.kept_variance,
        min_distance: params.resolved_min_distance(subject),
        max_distance: points.length(largest),
        mean_distance: total / count.max(1) as f64,
        mean_jumps: count as f64 / points.len() as f64,
        jumpless: accepted.counts.iter().filter(|c| **c == 0).count(),
    };
    let texels: Vec<[u16; 2]> = subject.domain.texels().collect();
    let jumps = par::map(count, |i| {
        let (to, squared) = accepted.matches[i];
        let [x, y] = texels[to as usize];
        Jump { x, y, p: probability(points.length(squared), report.max_distance, params) }
    });
    Ok((JumpMap::from_counts(subject.domain.clone(), &accepted.counts, jumps), report, recall))
}

/// Share of the true matches of some texels that were found.
fn recall(points: &Points, grid: &Grid, found: &Neighbours, matches: usize, sample_count: usize) -> f64 {
    let key = Key::new(0).with_str("recall");
    let counts = par::map_chunks(sample_count, 1, |r| {
        let texel = key.below(r.start as u64, points.len() as u32);
        let truth = knn::exhaustive(points, texel, matches, |a, b| grid.apart(a, b));
        let worst = truth.last().map_or(0, |m| m.1);
        let hits = found.row(texel).take(truth.len()).filter(|m| m.1 <= worst).count();
        (hits, truth.len())
    });
    let (hits, all) = counts.iter().fold((0, 0), |s, c| (s.0 + c.0, s.1 + c.1));
    if all == 0 { 1.0 } else { hits as f64 / all as f64 }
}

/// The exemplar as the search wants it.
struct Prepared {
    points: Points,
    grid: Grid,
    pca: pca::Pca,
    dimensions: usize,
}

/// Pyramid, neighbourhood vectors, principal components.
fn prepare(subject: &Subject, params: &AnalysisParams) -> Result<Prepared, Error> {
    let vectors = Neighbourhoods::new(subject, params);
    let dimensions = vectors.dims();
    let pca = pca::fit(&vectors.sample(SAMPLES.max(4 * dimensions)), dimensions, params.variance);
    params.check_memory(subject, pca.basis.len())?;
    let grid = Grid::new(subject, params.resolved_min_distance(subject));
    Ok(Prepared { points: vectors.project(&pca), grid, pca, dimensions })
}

/// The matches to jump to, texel by texel, best first: index and squared distance.
struct Accepted {
    counts: Vec<u8>,
    matches: Vec<(u32, u32)>,
}

impl Accepted {
    /// Poisson-disc filter: of each texel's best beta k matches, best first, those that keep their distance from the
    /// accepted ones, up to k. They all keep it from the texel. Source: \[ZG02\] 2.2.
    fn new(grid: &Grid, found: &Neighbours, len: usize, params: &AnalysisParams) -> Self {
        let parts = par::map_chunks(len, 1024, |range| {
            let mut part = Accepted { counts: Vec::with_capacity(range.len()), matches: vec![] };
            for texel in range {
                let first = part.matches.len();
                for candidate in found.row(texel as u32).take(params.matches()) {
                    let accepted = &part.matches[first..];
                    if accepted.len() == params.jumps as usize {
                        break;
                    }
                    if accepted.iter().all(|a| grid.apart(a.0, candidate.0)) {
                        part.matches.push(candidate);
                    }
                }
                part.counts.push((part.matches.len() - first) as u8);
            }
            part
        });
        let mut all = Accepted { counts: Vec::with_capacity(len), matches: vec![] };
        for part in parts {
            all.counts.extend_from_slice(&part.counts);
            all.matches.extend_from_slice(&part.matches);
        }
        all
    }
}

/// The probability of a jump over a distance. Source: \[ZG02\] Eq. 1.
fn probability(distance: f64, largest: f64, params: &AnalysisParams) -> f32 {
    let t = params.alpha * largest;
    let share = if t > 0.0 { (t - distance) / t } else { 1.0 };
    // A whole number of steps of 2^-16, so that it is exact, and no row's sum is above 1.
    let steps = (share * 256.0).floor().clamp(1.0, 256.0) as u32;
    (65536 / params.jumps * steps).div_euclid(256).max(1) as f32 / 65536.0
}
