//! Step: analyse the exemplar into textons (\[MK03\] section 3.1).

use crate::build::{Inputs, Step, StepError, Visitor};
use crate::exemplar::{JumpMap, TextonMap, TextonParams, analyse_textons};
use crate::io::artefact::{Artefact, Damaged, Reader, Writer};
use crate::numerics::knn::Points;
use crate::texture::MapSet;

/// Reads the maps.
pub(super) struct AnalyseTextons {
    pub recipe: String,
    pub params: TextonParams,
}

impl Artefact for TextonMap {
    const TAG: [u8; 4] = *b"txtn";

    fn write(&self, to: &mut Writer) {
        to.put([self.width(), self.height(), self.rotations(), self.points().dims() as u32]);
        (0..self.rotations()).for_each(|r| to.slice(self.labels(r)));
        to.slice(self.distances());
        to.put(self.points().scale());
        to.slice(self.points().data());
        to.slice(&self.alike().to_bytes());
    }

    fn read(from: &mut Reader<'_>) -> Result<Self, Damaged> {
        let [width, height, rotations, dims] = from.get::<[u32; 4]>()?;
        let labels = (0..rotations).map(|_| from.slice::<u16>()).collect::<Result<Vec<_>, Damaged>>()?;
        let distances: Vec<u32> = from.slice()?;
        let scale: f64 = from.get()?;
        let data: Vec<i16> = from.slice()?;
        let alike = JumpMap::from_bytes(&from.slice::<u8>()?).map_err(|e| Damaged(e.to_string()))?;
        let damaged = || Damaged("textons that do not fit their sample".into());
        let texels = labels.first().map_or(0, Vec::len);
        // The padding is known only once there are points; no more of them than there are values.
        if dims as usize > data.len() || texels > data.len() {
            return Err(damaged());
        }
        let mut points = Points::new(texels, dims as usize, scale);
        if points.data().len() != data.len() {
            return Err(damaged());
        }
        points.data_mut().copy_from_slice(&data);
        TextonMap::new([width, height], labels, distances, points, alike).ok_or_else(damaged)
    }
}

impl Step for AnalyseTextons {
    super::step_identity!("analyse textons", 3, travels);

    fn describe(&self, v: &mut dyn Visitor) {
        let TextonParams { window, count, features, rotations, importance, wrap } = &self.params;
        v.param("window", window);
        v.param("count", count);
        v.param("features", features);
        v.param("rotations", rotations);
        v.param("importance", importance);
        v.param("wrap", wrap);
    }

    fn run(&self, inputs: &Inputs) -> Result<Vec<u8>, StepError> {
        let maps: MapSet = super::read(inputs, 0)?;
        let (map, _) = analyse_textons(&maps, &self.params)?;
        Ok(map.to_bytes())
    }
}
