//! Chi-square quantiles, remembered.

use crate::chi2;

/// Chi-square quantiles, worked out once per level and degree of freedom.
#[derive(Clone, Debug, Default)]
pub(crate) struct Quantiles {
    /// By level, and then by degrees of freedom; NaN where none was asked for.
    tables: Vec<(f64, Vec<f64>)>,
}

/// Levels that are remembered: more than a filter has.
const LEVELS: usize = 8;

impl Quantiles {
    pub(crate) fn get(&mut self, level: f64, dof: usize) -> f64 {
        let known = self.tables.iter().position(|table| table.0 == level);
        let at = known.unwrap_or_else(|| {
            if self.tables.len() == LEVELS {
                self.tables.clear();
            }
            self.tables.push((level, Vec::new()));
            self.tables.len() - 1
        });
        let values = &mut self.tables[at].1;
        if values.len() <= dof {
            values.resize(dof + 1, f64::NAN);
        }
        if values[dof].is_nan() {
            values[dof] = chi2::quantile(level, dof as f64);
        }
        values[dof]
    }
}
