//! The working set of the local update: when it is chosen, and what joins it.

use super::ekf::Filter;
use super::measurements::Measurements;
use crate::local::OutsideSet;
use crate::state::{Block, State};

impl Filter {
    /// Chooses a working set where the map is large enough for it to pay, and anew once too many auxiliary rows have
    /// accumulated.
    pub(super) fn choose_working_set(&mut self, searched: &[u64]) {
        let features = self.map_size();
        let large = features >= self.settings.map.local_from;
        let choose = match &self.outside {
            Some(outside) => outside.is_full(&self.state),
            None => large && self.started && (4..features / 3).contains(&searched.len()),
        };
        if !choose {
            return;
        }
        if !large {
            self.make_whole();
            return;
        }
        let mut working: Vec<u64> = self.predict_pixels().iter().map(|f| f.id).collect();
        working.extend_from_slice(searched);
        working.extend_from_slice(self.followed());
        working.sort_unstable();
        let (state, buffers) = (State::at_origin(0), &mut self.buffers);
        let state = std::mem::replace(&mut self.state, state);
        let whole = match self.outside.take() {
            Some(outside) if self.undo.needs_outside() => {
                let whole = outside.assemble(&state, buffers);
                self.undo.put_by(outside);
                whole
            }
            Some(outside) => outside.into_whole(state, buffers),
            None => state,
        };
        let is_working = |block: &Block| working.binary_search(&block.id).is_ok();
        let (state, outside) = OutsideSet::split(whole, is_working, buffers);
        (self.state, self.outside) = (state, Some(outside));
    }

    /// Gives up the working set: the filter holds the whole state again.
    pub(super) fn make_whole(&mut self) {
        self.changes();
        if let Some(outside) = self.outside.take() {
            self.state = outside.assemble(&self.state, &mut self.buffers);
            self.undo.put_by(outside);
        }
    }

    /// Brings the features that are measured into the working set of the local update.
    pub(super) fn fetch(&mut self, z: &Measurements, ids: &mut Vec<u64>) {
        let Some(outside) = &mut self.outside else {
            return;
        };
        ids.clear();
        ids.extend(z.bearings.iter().map(|b| b.id));
        let further = z.further.iter().flat_map(|worn| &worn.pairs);
        ids.extend(z.pairs().iter().chain(further).filter_map(|p| p.id));
        ids.extend(z.depths.iter().filter_map(|d| d.id));
        ids.sort_unstable();
        ids.dedup();
        outside.enter(&mut self.state, |id| ids.binary_search(&id).is_ok());
    }
}
