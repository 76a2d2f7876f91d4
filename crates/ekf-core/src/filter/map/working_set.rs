//! The working set of the local update: when it is chosen, and what joins it.

use crate::filter::ekf::Filter;
use crate::filter::input::measurements::Measurements;
use crate::filter::predict::visibility::{SOON, visibility};
use crate::local::OutsideSet;
use crate::state::{Block, State};

impl Filter {
    /// Chooses a working set where the map is large enough for it to pay, and anew once too many auxiliary rows have
    /// accumulated; brings a share of what is outside of it up to date. Call it once in a frame.
    pub(crate) fn choose_working_set(&mut self, searched: &[u64]) {
        let features = self.map_size();
        let large = features >= self.setup.settings.map.local_from;
        if let Some(outside) = &mut self.memory.outside {
            outside.advance(&mut self.workspace.buffers);
        }
        let choose = match &self.memory.outside {
            Some(outside) => outside.is_full(&self.memory.state),
            None => large && self.memory.started && (4..features / 3).contains(&searched.len()),
        };
        if !choose {
            return;
        }
        if !large {
            self.make_whole();
            return;
        }
        // What is about to come into view would be in again with the first one that does.
        let pose = self.memory.state.camera_pose();
        let seen = visibility(&self.setup.camera, &pose);
        let soon = |b: &&Block| {
            let point = self.memory.state.feature(b).point();
            point.is_some_and(|point| seen(&point, -SOON))
        };
        let soon = self
            .memory
            .state
            .layout
            .features()
            .filter(soon)
            .map(|b| b.id);
        let mut working: Vec<u64> = soon.collect();
        working.extend_from_slice(searched);
        working.extend_from_slice(self.followed());
        working.sort_unstable();
        let (state, buffers) = (State::at_origin(0), &mut self.workspace.buffers);
        let state = std::mem::replace(&mut self.memory.state, state);
        let (state, outside) = match self.memory.outside.take() {
            Some(mut outside) => {
                // What is outside now comes in by itself when it is measured.
                let mut inside: Vec<u64> = state.layout.features().map(|b| b.id).collect();
                inside.sort_unstable();
                inside.retain(|id| working.binary_search(id).is_ok());
                let is_working = |block: &Block| inside.binary_search(&block.id).is_ok();
                let needed = self.undo.needs_outside();
                if !needed {
                    outside.settle(buffers);
                }
                let chosen = outside.renew(&state, is_working, buffers);
                if needed {
                    self.undo.put_by(outside);
                } else {
                    outside.give_up(buffers);
                }
                buffers.take_working(state);
                chosen
            }
            None => {
                let is_working = |block: &Block| working.binary_search(&block.id).is_ok();
                OutsideSet::split(state, is_working, buffers)
            }
        };
        (self.memory.state, self.memory.outside) = (state, Some(outside));
    }

    /// Gives up the working set: the filter holds the whole state again.
    pub(super) fn make_whole(&mut self) {
        self.changes();
        if let Some(mut outside) = self.memory.outside.take() {
            outside.finish(&mut self.workspace.buffers);
            self.memory.state = outside.assemble(&self.memory.state, &mut self.workspace.buffers);
            self.undo.put_by(outside);
        }
    }

    /// Brings the features that are measured into the working set of the local update.
    pub(crate) fn fetch(&mut self, z: &Measurements, ids: &mut Vec<u64>) {
        let Some(outside) = &mut self.memory.outside else {
            return;
        };
        ids.clear();
        ids.extend(z.bearings.iter().map(|b| b.id));
        let pairs = z.views.iter().flat_map(|worn| &worn.pairs);
        ids.extend(pairs.filter_map(|p| p.id));
        ids.extend(z.depths.iter().filter_map(|d| d.id));
        ids.sort_unstable();
        ids.dedup();
        outside.enter(&mut self.memory.state, |id| ids.binary_search(&id).is_ok());
    }
}
