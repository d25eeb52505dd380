//! Appearance vectors: what the surroundings of a texel look like, in a few numbers.
//!
//! Source: Lefebvre, Hoppe: Appearance-space texture synthesis (2006), section 3: the neighbourhood vectors of the
//! exemplar, projected on their leading principal components, take the place of colours in comparisons. Two texels with
//! near appearances can stand for each other though only one texel of each was compared.
//! In: maps, parameters (of which neighbourhoods, importance and wrap count), a number of components. Out: a texture.
//! Unaware of: jumps, synthesis.

use super::neighbourhood::Neighbourhoods;
use super::sheet::{Sheet, Subject};
use super::{AnalysisParams, Error};
use crate::numerics::pca;
use crate::texture::{MapSet, Texture};

/// Texels whose vectors are used to find the principal components. Half of the analysis' number: the few leading
/// ones settle early, and the covariance would take most of the time.
const SAMPLES: usize = 1024;

/// The appearance of every texel of an exemplar.
#[derive(Clone, Debug, PartialEq)]
pub struct Appearance {
    /// One channel per component, largest variance first. The squared distance of two texels is nearly the mean squared
    /// difference of their neighbourhoods' values (times `kept_variance`, on average). Zeros where there are fewer
    /// components than were asked for.
    pub features: Texture,
    /// Share of the neighbourhoods' variance that the components hold, 0..=1.
    pub kept_variance: f64,
}

/// The appearance of every texel in `components` numbers (none asks for one).
///
/// The neighbourhoods are those of `params`, and are better smaller than for the analysis: \[9, 5, 3\] blurs seams.
/// The same for any number of threads. Fails as [`super::analyse`] does.
pub fn appearance(maps: &MapSet, params: &AnalysisParams, components: usize) -> Result<Appearance, Error> {
    of_subject(&Subject::sample(maps, params)?, params, components)
}

/// The appearance of every texel of a sheet's samples, as [`appearance`], laid out as the sheet. Fails as
/// [`super::analyse_sheet`] does.
pub fn appearance_sheet(sheet: &Sheet, params: &AnalysisParams, components: usize) -> Result<Appearance, Error> {
    of_subject(&Subject::sheet(sheet, params)?, params, components)
}

fn of_subject(subject: &Subject, params: &AnalysisParams, components: usize) -> Result<Appearance, Error> {
    let components = components.clamp(1, params.dimensions(subject.maps));
    params.check_memory(subject, 2 * components)?;
    let vectors = Neighbourhoods::new(subject, params);
    let dims = vectors.dims();
    let pca = pca::fit_up_to(&vectors.sample(SAMPLES.max(2 * dims)), dims, 1.0, components);
    let size = (subject.maps.width(), subject.maps.height());
    let features = vectors.features(&pca, 1.0 / (dims as f64).sqrt(), components as u32, size);
    Ok(Appearance { features, kept_variance: pca.kept_variance })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::numerics::{par::install, rng::Key};
    use crate::texture::MapKind;

    fn noise(width: u32, height: u32) -> MapSet {
        let value = |x: u32, y: u32| Key::new(4).with(u64::from(y / 2)).unit(u64::from(x / 2)) as f32;
        MapSet::new(vec![(MapKind::Height, Texture::from_fn(width, height, 1, |x, y, out| out[0] = value(x, y)))])
    }

    fn params(neighbourhoods: &[u32]) -> AnalysisParams {
        AnalysisParams { neighbourhoods: neighbourhoods.to_vec(), ..AnalysisParams::default() }
    }

    fn squared(features: &Texture, a: (u32, u32), b: (u32, u32)) -> f64 {
        let pairs = features.get(a.0, a.1).iter().zip(features.get(b.0, b.1));
        pairs.map(|(a, b)| square(f64::from(a - b))).sum()
    }

    fn square(v: f64) -> f64 {
        v * v
    }

    #[test]
    fn with_all_components_distances_are_those_of_the_neighbourhoods() {
        let maps = noise(21, 17);
        let a = appearance(&maps, &params(&[3]), 99).unwrap();
        assert_eq!((a.features.channels(), a.features.width(), a.features.height()), (9, 21, 17));
        assert!((a.kept_variance - 1.0).abs() < 1e-9);
        let map = maps.get(MapKind::Height).unwrap();
        let (p, q) = ((4, 5), (12, 9));
        let around = (0..9).map(|i| (i % 3, i / 3));
        let value = |c: (u32, u32), (dx, dy): (u32, u32)| f64::from(map.get(c.0 + dx - 1, c.1 + dy - 1)[0]);
        let want = around.map(|d| square(value(p, d) - value(q, d))).sum::<f64>() / 9.0;
        assert!((squared(&a.features, p, q) - want).abs() < 1e-5);
    }

    #[test]
    fn leading_components_keep_most_and_do_not_depend_on_threads() {
        let maps = noise(64, 40);
        let run = |jobs| install(jobs, || appearance(&maps, &params(&[5, 3]), 8).unwrap());
        let a = run(1);
        assert_eq!(a, run(3));
        assert_eq!(a.features.channels(), 8);
        let all = appearance(&maps, &params(&[5, 3]), 34).unwrap();
        let (mut few, mut whole) = (0.0, 0.0);
        for x in 0..60 {
            few += squared(&a.features, (x, 7), (63 - x, 30));
            whole += squared(&all.features, (x, 7), (63 - x, 30));
        }
        assert!((few / whole - a.kept_variance).abs() < 0.1, "{} {}", few / whole, a.kept_variance);
        assert!((0.5..1.0).contains(&a.kept_variance));
    }

    #[test]
    fn a_constant_exemplar_looks_alike_everywhere() {
        let maps = MapSet::new(vec![(MapKind::Height, Texture::from_fn(16, 16, 1, |_, _, out| out[0] = 0.5))]);
        let a = appearance(&maps, &params(&[5]), 4).unwrap();
        assert!(a.features.data().iter().all(|v| v.abs() < 1e-6));
        assert_eq!((a.features.channels(), a.kept_variance), (4, 1.0));
    }

    #[test]
    fn fails_as_the_analysis_does() {
        let fault = appearance(&noise(4, 4), &params(&[5]), 8).unwrap_err().to_string();
        assert_eq!(fault, "the exemplar is 4x4 texels, the finest neighbourhood needs at least 5x5");
    }
}
