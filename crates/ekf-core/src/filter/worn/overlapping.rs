//! Overlaps with a worn camera: what lasts of T_CF's error is another error in each (METHOD 6).

use crate::filter::ekf::Filter;
use crate::filter::input::measurements::WornObservation;
use crate::filter::memory::last_view::LastView;
use crate::state::ErrorOwner;

impl Filter {
    /// Forgets the error of the last overlap where a view begins another, unless the view says itself what lasts of its error; what
    /// all worn cameras have in common of it goes where none of them overlaps any more.
    pub(crate) fn begin_overlap(&mut self, worn: &WornObservation) {
        let now = self.memory.time.unwrap_or(0.0);
        let going_on = self
            .memory
            .last_views
            .iter()
            .filter(|last| last.goes_on(now));
        let (mut any, mut own) = (false, false);
        for last in going_on {
            any = true;
            own |= last.who == worn.who;
        }
        if self.stated_bias(worn.bias.as_ref()).is_some() || own {
            return;
        }
        self.memory
            .state
            .end_time_correlated(ErrorOwner::Of(worn.who));
        if !any {
            self.memory.state.end_time_correlated(ErrorOwner::Common);
        }
    }

    /// A view of a worn camera was used.
    pub(crate) fn go_on_overlapping(&mut self, who: usize) {
        let t = self.memory.time.unwrap_or(0.0);
        self.memory.last_views.retain(|last| last.who != who);
        if self.memory.started {
            self.memory.last_views.push(LastView { who, t });
        }
    }
}
