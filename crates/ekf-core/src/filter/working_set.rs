//! The working set of the local update (`map.local`): when it is chosen, and what joins it.

use super::ekf::Filter;
use super::measurements::Measurements;
use crate::local::Far;
use crate::state::{Block, State};

impl Filter {
    /// Keeps the working set of `map.local` small: chooses it anew when dual rows have gathered.
    pub(super) fn choose_working_set(&mut self, searched: &[u64]) {
        let choose = match &self.far {
            Some(far) => far.is_full(&self.state),
            None => self.started && (4..self.map_size() / 3).contains(&searched.len()),
        };
        if !self.settings.map.local || !choose {
            return;
        }
        let mut near: Vec<u64> = self.predict_pixels().iter().map(|f| f.id).collect();
        near.extend_from_slice(searched);
        if self.carries() {
            near.extend_from_slice(self.followed());
        }
        near.sort_unstable();
        let (state, spare) = (State::at_origin(0), &mut self.spare);
        let state = std::mem::replace(&mut self.state, state);
        let whole = match self.far.take() {
            Some(far) => far.into_whole(state, spare),
            None => state,
        };
        let is_near = |block: &Block| near.binary_search(&block.id).is_ok();
        let (state, far) = Far::split(whole, is_near, spare);
        (self.state, self.far) = (state, Some(far));
    }

    /// Puts the whole state together, without a working set of `map.local`.
    pub(super) fn make_whole(&mut self) {
        self.changes();
        if let Some(far) = self.far.take() {
            self.state = far.settle(&self.state, &mut self.spare);
        }
    }

    /// Brings what is measured or was looked for into the working set of the local update.
    pub(super) fn fetch(&mut self, z: &Measurements, ids: &mut Vec<u64>) {
        let Some(far) = &mut self.far else { return };
        ids.clear();
        ids.extend(z.bearings.iter().map(|b| b.id));
        ids.extend(z.pairs().iter().filter_map(|p| p.id));
        ids.extend(z.depths.iter().filter_map(|d| d.id));
        ids.sort_unstable();
        far.enter(&mut self.state, |id| ids.binary_search(&id).is_ok());
    }
}
