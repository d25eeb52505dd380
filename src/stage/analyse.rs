//! Step: analyse the exemplar into a jump map (\[ZG02\] section 2).

use crate::build::{Inputs, Step, StepError, Visitor};
use crate::exemplar::{AnalysisParams, analyse, analyse_sheet};
use crate::texture::MapSet;

use super::sheet::Form;

/// Reads the maps, or a sheet of samples.
pub(super) struct Analyse {
    pub recipe: String,
    pub params: AnalysisParams,
    /// True if the input is a sheet.
    pub stacked: bool,
}

impl Step for Analyse {
    super::step_identity!("analyse", 4, travels);

    fn describe(&self, v: &mut dyn Visitor) {
        describe(&self.params, v);
        v.param("sheet", &self.stacked);
    }

    fn run(&self, inputs: &Inputs) -> Result<Vec<u8>, StepError> {
        let map = if self.stacked {
            let form = Form { stacked: true, wrap: self.params.wrap };
            analyse_sheet(form.read(inputs, 0)?.sheet(), &self.params)?.0
        } else {
            let maps: MapSet = super::read(inputs, 0)?;
            analyse(&maps, &self.params)?.0
        };
        Ok(map.to_bytes())
    }
}

/// Visits the parameters of an analysis, of stills and flipbooks alike.
pub(super) fn describe(params: &AnalysisParams, v: &mut dyn Visitor) {
    let AnalysisParams { neighbourhoods, jumps, diversity, variance, alpha, min_distance, importance, wrap } = params;
    v.param("neighbourhoods", neighbourhoods);
    v.param("jumps", jumps);
    v.param("diversity", diversity);
    v.param("variance", variance);
    v.param("alpha", alpha);
    v.param("min_distance", min_distance);
    v.param("importance", importance);
    v.param("wrap", wrap);
}
