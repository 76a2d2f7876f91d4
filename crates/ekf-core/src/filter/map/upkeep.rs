//! Upkeep of the map (METHOD 7, step 8).

use crate::birth::new_feature::NewFeature;
use crate::error::EkfError;
use crate::filter::ekf::Filter;
use crate::filter::memory::candidate::FirstView;
use crate::filter::memory::record::FeatureRecord;
use crate::guard;
use crate::observe::POSE_DIM;
use crate::state::{Block, BlockKind, LinearPart};

/// A feature is deleted when the share of its searches that found it falls below this.
const MIN_FOUND_SHARE: f64 = 0.4;
/// Searches after which that is asked.
const MIN_SEARCHES: usize = 8;

impl Filter {
    /// Puts a newborn feature into the state, if its numbers are ones that the state may hold.
    pub(crate) fn append_feature(&mut self, new: &NewFeature) -> Option<Block> {
        if !guard::newborn_is_sane(new) {
            return None;
        }
        let mut parts = vec![LinearPart {
            offset: 0,
            width: POSE_DIM,
            matrix: new.by_pose.as_slice(),
        }];
        parts.extend(new.by_others.iter().map(|part| LinearPart {
            offset: part.offset,
            width: part.width,
            matrix: &part.by.as_slice()[..6 * part.width],
        }));
        if let Some(offset) = self.memory.state.calibration() {
            parts.push(LinearPart {
                offset,
                width: 6,
                matrix: new.by_calibration.as_slice(),
            });
        }
        let block = self
            .memory
            .state
            .append_feature(&new.mean, &parts, &new.noise);
        if !guard::newborn_is_located(&self.memory.state, &block) {
            self.memory.state.remove(|b| b.id == block.id);
            return None;
        }
        let record = FeatureRecord {
            last_found: self.memory.time.unwrap_or(0.0),
            ..FeatureRecord::default()
        };
        self.memory.records.insert(block.id, record);
        self.memory.followed.add(block.id);
        Some(block)
    }

    /// Removes features at once.
    ///
    /// # Errors
    /// `UnknownFeature`; nothing is removed then.
    pub fn remove_features(&mut self, ids: &[u64]) -> Result<(), EkfError> {
        for &id in ids {
            self.memory.known(id)?;
        }
        self.remove_blocks(ids);
        Ok(())
    }

    pub(crate) fn remove_blocks(&mut self, ids: &[u64]) {
        self.changes();
        if let Some(outside) = &mut self.memory.outside {
            outside.remove(&mut self.memory.state, |id| ids.contains(&id));
        }
        self.memory.state.remove(|b| ids.contains(&b.id));
        for id in ids {
            self.memory.records.remove(id);
        }
    }

    /// Deletes features that keep failing or whose depth went wrong, the longest unseen beyond
    /// `map.max_features`, candidates that are too old and clones that nobody needs. Returns the ids of deleted features. Those of
    /// `keep` are not too many, however long they were not seen, and do not count for `map.max_features`; what keeps
    /// failing goes all the same.
    pub fn manage_map(&mut self, keep: &[u64]) -> Vec<u64> {
        let map = &self.setup.settings.map;
        let now = self.memory.time.unwrap_or(0.0);
        let mut gone: Vec<u64> = Vec::new();
        let mut kept: Vec<(f64, u64)> = Vec::new();
        let working = self.memory.state.layout.features();
        let working = working.map(|block| (*block, self.memory.state.feature(block)));
        let mut features: Vec<_> = working.collect();
        if let Some(outside) = &self.memory.outside {
            features.extend(outside.means(&self.memory.state));
            features.sort_unstable_by_key(|(block, _)| block.id);
        }
        for (block, feature) in features {
            let record = &self.memory.records[&block.id];
            let failing = record.searched >= MIN_SEARCHES
                && (record.found as f64) < MIN_FOUND_SHARE * record.searched as f64;
            if failing || feature.point().is_none() {
                gone.push(block.id);
            } else if !keep.contains(&block.id) {
                kept.push((record.last_found, block.id));
            }
        }
        if kept.len() > map.max_features {
            kept.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
            let excess = kept.len() - map.max_features;
            gone.extend(kept[..excess].iter().map(|(_, id)| *id));
        }
        let age = map.candidate_age;
        self.memory.candidates.retain(|_, c| now - c.since <= age);
        let mut needed: Vec<u64> = self
            .memory
            .candidates
            .values()
            .filter_map(|c| match c.first {
                FirstView::Clone(id) => Some(id),
                FirstView::Remembered(..) => None,
            })
            .collect();
        needed.dedup();
        needed.extend(self.memory.kept_poses.ids());
        self.changes();
        if let Some(outside) = &mut self.memory.outside {
            outside.remove(&mut self.memory.state, |id| gone.contains(&id));
        }
        self.memory.state.remove(|b| match b.kind {
            BlockKind::Feature => gone.contains(&b.id),
            BlockKind::Clone => !needed.contains(&b.id),
            _ => false,
        });
        for id in &gone {
            self.memory.records.remove(id);
        }
        gone
    }
}
