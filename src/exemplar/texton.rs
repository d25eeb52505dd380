//! Textons: clusters of alike neighbourhoods, and which texel belongs to which.
//!
//! Source: \[MK03\] section 3.1. In: the maps of a sample. Out: a [`TextonMap`], that is the texton texture (tau), the
//! bucket array B and the distances of all pairs of textons, and the texels' own vectors.
//! Reads as: clusters start from a k-centre (Hochbaum and Shmoys, listed among the references and not in the text); k-means
//! ends when 99 % of the texels keep their cluster (table 1); "auto" is the square root of the number of texels (section
//! 4). Distances are squared differences of cluster centres in the space of the principal components.
//! Rotated textons, which the paper leaves out for the size of their table, need none: what a texel looks like to someone
//! whose texture is turned is assigned to the same clusters, so that each further orientation costs one assignment and
//! one label per texel.
//! Beyond the paper each texel knows those of its bucket that look most like it: places to go on at behind a seam.
//! Unaware of: meshes, files.

use std::collections::BTreeMap;

use super::params::{AnalysisParams, check_size};
use super::texton_features::Features;
use super::{Jump, JumpMap, TextonError, TextonFeatures};
use crate::numerics::knn::Points;
use crate::numerics::{kmeans, par};
use crate::texture::{MapKind, MapSet, Wrap};

/// Largest side of a window.
const MAX_WINDOW: u32 = 33;
/// Most textons: the table of their distances has 64 MiB then.
const MAX_COUNT: u32 = 4096;
/// Most orientations.
const MAX_ROTATIONS: u32 = 64;
/// Share of the texels that keep their cluster in the last iteration (\[MK03\] table 1).
const SETTLED: f64 = 0.99;
/// Most iterations; 99 % are settled after ten to thirty.
const MOST_ITERATIONS: u32 = 200;

/// Texels that are noted as alike, of each.
const ALIKE: usize = 3;
/// How far they are from each other and from it, as a share of the exemplar's shorter side.
const APART: f64 = 0.04;
/// Most texels of a bucket that are looked at to find them.
const LOOKED_AT: usize = 512;

/// How textons are made.
#[derive(Clone, Debug, PartialEq)]
pub struct TextonParams {
    /// Side of the window in texels, odd, 3..=33. 11 in \[MK03\] 4.
    pub window: u32,
    /// Number of textons, 1..=4096; `None`: the square root of the number of texels, rounded down, at most 4096.
    pub count: Option<u32>,
    /// What is clustered.
    pub features: TextonFeatures,
    /// Orientations, 1..=64, for which there are labels, evenly spaced; 1 is the published method.
    pub rotations: u32,
    /// Factor of each map's squared differences, 0..=1e6; maps that are not listed count nothing.
    pub importance: BTreeMap<MapKind, f64>,
    /// What lies beyond the borders: the exemplar again, or (clamp) its mirror image.
    pub wrap: Wrap,
}

impl Default for TextonParams {
    fn default() -> Self {
        TextonParams {
            window: 11,
            count: None,
            features: TextonFeatures::Window,
            rotations: 1,
            importance: AnalysisParams::default().importance,
            wrap: Wrap::Clamp,
        }
    }
}

/// What an analysis found.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TextonReport {
    /// Components of a feature vector.
    pub dimensions: usize,
    /// Components kept.
    pub kept_dimensions: usize,
    /// Share of the variance that they hold, 0..=1.
    pub kept_variance: f64,
    /// Iterations of k-means.
    pub iterations: u32,
    /// Root of the mean squared distance of texels from their textons, in the features' unit.
    pub spread: f64,
}

/// The textons of a sample.
#[derive(Clone, Debug, PartialEq)]
pub struct TextonMap {
    width: u32,
    height: u32,
    count: u32,
    /// `labels[r][texel]` for orientation r of `labels.len()`.
    labels: Vec<Vec<u16>>,
    /// Texels by texton: those of t are `members[starts[t]..starts[t + 1]]`, ascending.
    starts: Vec<u32>,
    members: Vec<u32>,
    /// Squared distances of textons, row by row.
    distances: Vec<u32>,
    points: Points,
    alike: JumpMap,
}

impl TextonMap {
    /// From the labels of each orientation (at least one, `width * height` each, below `count`), the textons' squared
    /// distances, the texels' vectors and what is alike; `None` if they do not fit each other.
    pub fn new(
        size: [u32; 2],
        labels: Vec<Vec<u16>>,
        distances: Vec<u32>,
        points: Points,
        alike: JumpMap,
    ) -> Option<Self> {
        let texels = size[0] as usize * size[1] as usize;
        let count = (1..=MAX_COUNT as usize).find(|k| k * k >= distances.len())?;
        let fits = count * count == distances.len() && texels > 0 && points.len() == texels && !labels.is_empty();
        let fits = fits && [alike.width(), alike.height()] == size;
        if !fits || labels.iter().any(|l| l.len() != texels || l.iter().any(|t| usize::from(*t) >= count)) {
            return None;
        }
        let mut starts = vec![0u32; count + 1];
        labels[0].iter().for_each(|t| starts[usize::from(*t) + 1] += 1);
        (0..count).for_each(|t| starts[t + 1] += starts[t]);
        let (mut next, mut members) = (starts.clone(), vec![0; texels]);
        for (i, t) in labels[0].iter().enumerate() {
            members[next[usize::from(*t)] as usize] = i as u32;
            next[usize::from(*t)] += 1;
        }
        Some(TextonMap {
            width: size[0],
            height: size[1],
            count: count as u32,
            labels,
            starts,
            members,
            distances,
            points,
            alike,
        })
    }

    /// Texels per row.
    pub fn width(&self) -> u32 {
        self.width
    }

    /// Rows.
    pub fn height(&self) -> u32 {
        self.height
    }

    /// Number of textons, at least 1.
    pub fn count(&self) -> u32 {
        self.count
    }

    /// What whoever looks at the result should know of the sample.
    pub fn note(&self) -> Option<&'static str> {
        (self.count == 1)
            .then_some("the sample looks the same everywhere: one texton, and any place is as good as another")
    }

    /// Number of orientations for which there are labels, at least 1.
    pub fn rotations(&self) -> u32 {
        self.labels.len() as u32
    }

    /// The texton texture as seen in orientation `rotation` of [`TextonMap::rotations`], turned by that share of a full
    /// turn from x towards y; 0 is the sample as it lies. Texels row by row.
    pub fn labels(&self, rotation: u32) -> &[u16] {
        &self.labels[rotation as usize]
    }

    /// The texels of a texton, ascending, counted row by row: B\[t\] of \[MK03\].
    pub fn bucket(&self, texton: u16) -> &[u32] {
        let t = usize::from(texton);
        &self.members[self.starts[t] as usize..self.starts[t + 1] as usize]
    }

    /// Squared distance of two textons, in integer steps of [`TextonMap::points`].
    #[inline]
    pub fn distance(&self, a: u16, b: u16) -> u32 {
        self.distances[usize::from(a) * self.count as usize + usize::from(b)]
    }

    /// The table of squared distances, row by row.
    pub fn distances(&self) -> &[u32] {
        &self.distances
    }

    /// The feature vector of each texel.
    pub fn points(&self) -> &Points {
        &self.points
    }

    /// For each texel those of its bucket that look most like it, apart from each other and from it.
    pub fn alike(&self) -> &JumpMap {
        &self.alike
    }
}

/// Makes the textons of a sample.
///
/// The result is the same for any number of threads. There are fewer textons than asked for if there are fewer different
/// neighbourhoods (one in a constant exemplar). Source: \[MK03\] section 3.1. Fails if a parameter is out of range, the
/// exemplar is smaller than the window or has fewer texels than textons, or as any analysis does.
pub fn analyse_textons(maps: &MapSet, params: &TextonParams) -> Result<(TextonMap, TextonReport), TextonError> {
    let TextonParams { window, count: _, features, rotations, importance, wrap } = params;
    let size = (maps.width(), maps.height());
    let texels = u64::from(size.0) * u64::from(size.1);
    check_size(size.0.into(), size.1.into())?;
    let count = check(params, size)?;
    let compared = if *features == TextonFeatures::Window { *window } else { 1 };
    let as_analysis =
        AnalysisParams { neighbourhoods: vec![compared], importance: importance.clone(), ..AnalysisParams::default() };
    as_analysis.check_numbers()?;
    as_analysis.check_maps(maps)?;
    let vectors = Features::new(maps, importance, *window, *features, *wrap, *rotations > 1);
    let points = vectors.points(0.0);
    let clusters = kmeans::kmeans(&points, count as usize, SETTLED, MOST_ITERATIONS);
    let narrow = |of: &[u32]| of.iter().map(|t| *t as u16).collect::<Vec<u16>>();
    let mut labels = vec![narrow(&clusters.of)];
    for r in 1..*rotations {
        let angle = std::f64::consts::TAU * f64::from(r) / f64::from(*rotations);
        labels.push(narrow(&kmeans::assign(&vectors.points(angle), &clusters.centres)));
    }
    let k = clusters.centres.len() as u32;
    let distances = par::map((k * k) as usize, |i| clusters.centres.squared_distance(i as u32 / k, i as u32 % k));
    let to_centre = |i: usize| f64::from(clusters.centres.squared_distance_to(clusters.of[i], points.point(i as u32)));
    let spread = ((0..points.len()).map(to_centre).sum::<f64>() / texels as f64).sqrt() / points.scale();
    let report = TextonReport {
        dimensions: vectors.dims(),
        kept_dimensions: vectors.components(),
        kept_variance: vectors.kept_variance(),
        iterations: clusters.iterations,
        spread,
    };
    let alike = most_alike(&labels[0], k, [size.0, size.1], &points);
    let map = TextonMap::new([size.0, size.1], labels, distances, points, alike);
    Ok((map.expect("labels, distances and points of one clustering"), report))
}

/// For each texel up to [`ALIKE`] others with its label, the nearest vectors first.
fn most_alike(labels: &[u16], count: u32, [width, height]: [u32; 2], points: &Points) -> JumpMap {
    let mut buckets = vec![vec![]; count as usize];
    labels.iter().enumerate().for_each(|(i, t)| buckets[usize::from(*t)].push(i as u32));
    let apart = (f64::from(width.min(height)) * APART).max(1.0) as i32;
    let far = |a: u32, b: u32| {
        let (dx, dy) = ((a % width) as i32 - (b % width) as i32, (a / width) as i32 - (b / width) as i32);
        dx.abs().max(dy.abs()) >= apart
    };
    let row = |i: u32, near: &mut Vec<(u32, u32)>| {
        let bucket = &buckets[usize::from(labels[i as usize])];
        // Large buckets hold much of the same; each texel looks at another part.
        let stride = bucket.len().div_ceil(LOOKED_AT);
        let some = bucket.iter().skip(i as usize % stride.max(1)).step_by(stride.max(1));
        near.clear();
        near.extend(some.filter(|j| far(i, **j)).map(|j| (points.squared_distance(i, *j), *j)));
        let mut row: Vec<u32> = vec![];
        while row.len() < ALIKE {
            let Some(best) = near.iter().filter(|n| row.iter().all(|r| far(*r, n.1))).min() else { break };
            row.push(best.1);
        }
        let jump = |j: &u32| Jump { x: (j % width) as u16, y: (j / width) as u16, p: 1.0 / ALIKE as f32 };
        row.iter().map(jump).collect::<Vec<_>>()
    };
    let rows = par::map_chunks(labels.len(), 1024, |some| {
        let mut near = vec![];
        some.map(|i| row(i as u32, &mut near)).collect::<Vec<_>>()
    });
    JumpMap::from_rows(width, height, &rows.concat())
}

/// Checks the numbers; returns how many textons there shall be.
fn check(params: &TextonParams, size: (u32, u32)) -> Result<u32, TextonError> {
    let window = params.window;
    if window.is_multiple_of(2) || !(3..=MAX_WINDOW).contains(&window) {
        return Err(TextonError::Window { side: window, max: MAX_WINDOW });
    }
    if !(1..=MAX_ROTATIONS).contains(&params.rotations) {
        return Err(TextonError::Rotations { found: params.rotations, max: MAX_ROTATIONS });
    }
    if size.0.min(size.1) < window {
        return Err(TextonError::TooSmall { size, window });
    }
    let texels = u64::from(size.0) * u64::from(size.1);
    let Some(count) = params.count else {
        return Ok((texels as f64).sqrt().floor().min(f64::from(MAX_COUNT)) as u32);
    };
    if !(1..=MAX_COUNT).contains(&count) {
        return Err(TextonError::Count { found: count, max: MAX_COUNT });
    }
    if u64::from(count) > texels {
        return Err(TextonError::FewTexels { texels, count });
    }
    Ok(count)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::numerics::rng::Key;
    use crate::texture::Texture;

    fn maps(w: u32, h: u32, f: impl Fn(u32, u32) -> f32 + Sync) -> MapSet {
        MapSet::new(vec![(MapKind::Height, Texture::from_fn(w, h, 1, |x, y, out| out[0] = f(x, y)))])
    }

    fn noise(x: u32, y: u32) -> f32 {
        Key::new(2).with(u64::from(x / 2)).unit(u64::from(y / 2)) as f32
    }

    #[test]
    fn buckets_hold_each_texel_once_with_its_label() {
        let (map, report) =
            analyse_textons(&maps(30, 25, noise), &TextonParams { rotations: 4, ..Default::default() }).unwrap();
        assert_eq!((map.count(), map.rotations(), report.dimensions), (27, 4, 121));
        let mut all: Vec<u32> = vec![];
        for t in 0..map.count() as u16 {
            let members = map.bucket(t);
            assert!(members.iter().all(|i| map.labels(0)[*i as usize] == t));
            all.extend(members);
            assert_eq!(map.distance(t, t), 0);
            assert_eq!(map.distance(t, 3), map.distance(3, t));
        }
        all.sort_unstable();
        assert_eq!(all, (0..750).collect::<Vec<u32>>());
    }

    #[test]
    fn a_periodic_sample_has_periodic_textons() {
        let m = maps(32, 32, |x, y| noise(x % 8, y % 8));
        let (map, _) =
            analyse_textons(&m, &TextonParams { wrap: Wrap::Repeat, window: 5, ..Default::default() }).unwrap();
        let label = |x: usize, y: usize| map.labels(0)[y * 32 + x];
        assert!((0..24).all(|y| (0..24).all(|x| label(x, y) == label(x + 8, y + 8))));
        assert!(map.count() <= 64, "no more than different neighbourhoods: {}", map.count());
    }

    #[test]
    fn a_constant_has_one_texton() {
        let (map, report) = analyse_textons(&maps(16, 16, |_, _| 0.5), &TextonParams::default()).unwrap();
        assert_eq!((map.count(), report.spread, map.bucket(0).len()), (1, 0.0, 256));
    }

    #[test]
    fn the_same_for_any_number_of_threads() {
        let m = maps(40, 33, noise);
        for features in [TextonFeatures::Window, TextonFeatures::FilterBank] {
            let params = TextonParams { features, rotations: 3, ..Default::default() };
            let run = |jobs| par::install(jobs, || analyse_textons(&m, &params).unwrap());
            assert_eq!(run(1), run(3));
        }
    }

    #[test]
    fn bad_input_gets_a_sentence() {
        let fault = |w, params: TextonParams| analyse_textons(&maps(w, 20, noise), &params).unwrap_err().to_string();
        let d = TextonParams::default;
        assert_eq!(
            fault(20, TextonParams { window: 12, ..d() }),
            "window = 12, expected an odd number of texels in 3..=33"
        );
        assert_eq!(
            fault(20, TextonParams { window: 21, ..d() }),
            "the exemplar is 20x20 texels, a texton's window needs at least 21x21"
        );
        assert_eq!(fault(20, TextonParams { count: Some(0), ..d() }), "count = 0 textons, expected 1..=4096");
        assert_eq!(
            fault(20, TextonParams { count: Some(401), ..d() }),
            "count = 401 textons of an exemplar of 400 texels: expected at most one per texel; \"auto\" takes the square root"
        );
        assert_eq!(fault(20, TextonParams { rotations: 0, ..d() }), "rotations = 0, expected 1..=64");
        assert!(fault(20, TextonParams { importance: BTreeMap::new(), ..d() }).contains("importance"));
    }
}
