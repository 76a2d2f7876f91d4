//! Births with a vague depth: of what has shown no parallax when the view runs out of features (METHOD 5).

use crate::birth::new_feature::NewFeature;
use crate::error::EkfError;
use crate::filter::ekf::Filter;
use crate::filter::memory::candidate::FirstView;
use crate::filter::memory::guess::Guess;
use crate::guard::check_once;
use crate::scale::LogRange;
use crate::state::Block;
use nalgebra::SMatrix;

/// Inverse depth of a candidate that waits for parallax no longer where the map tells none, 1/m: what has shown none is far.
const VAGUE_RHO: f64 = 0.1;
/// Its standard deviation, 1/m.
const VAGUE_RHO_SD: f64 = 0.2;

/// Share of its first standard deviation above which a guess is still one.
const VAGUE: f64 = 0.3;
/// Share of a guess that those of other points that come into view at that time have in common: half of the variance.
const ALIKE: f64 = std::f64::consts::FRAC_1_SQRT_2;

/// What the scene says of the depth of a point of which nothing else is known.
#[derive(Clone, Copy, Debug)]
pub(crate) struct VagueDepth {
    /// Inverse depth, 1/m.
    pub(crate) rho: f64,
    /// Its standard deviation, 1/m.
    pub(crate) sd: f64,
    /// The landmark that has twice as much.
    half_of: Option<u64>,
}

/// A vague depth given another one: it depends on the feature at `offset`, and what it has alone is `sd`.
struct CommonGuess {
    offset: usize,
    rho: f64,
    sd: f64,
    by: SMatrix<f64, 1, 6>,
}

impl Filter {
    /// Ends the wait of candidates for parallax: each is born undelayed, as a feature of its first view with a weak prior
    /// on its inverse depth, from that of the scene (METHOD 5). None where that gives no feature; the candidate is gone in
    /// any case. Depths that are `alike` have half of their variance in common, and with those of before that are still vague:
    /// however many they are, they do not tell how large the scene is.
    ///
    /// # Errors
    /// `UnknownFeature` for an id that is not a candidate, `InvalidInput` for one given twice; nothing changes then.
    pub fn promote_candidates(
        &mut self,
        ids: &[u64],
        alike: bool,
    ) -> Result<Vec<Option<u64>>, EkfError> {
        check_once("candidates", ids.iter().copied(), &mut Vec::new())?;
        if let Some(&id) = ids
            .iter()
            .find(|id| !self.memory.candidates.contains_key(id))
        {
            return Err(EkfError::UnknownFeature { id });
        }
        if ids.is_empty() {
            return Ok(Vec::new());
        }
        let vague = self.vague_depth();
        self.changes();
        self.forget_guesses();
        if let (Some(outside), Some(median)) = (&mut self.memory.outside, vague.half_of) {
            outside.enter(&mut self.memory.state, |id| id == median);
        }
        let sigma = self.setup.settings.pixel.sigma_cs;
        let median = self.median_range(&vague);
        let mut born = Vec::with_capacity(ids.len());
        let mut view = None;
        for id in ids {
            let candidate = self.memory.candidates.remove(id);
            let clone = candidate.as_ref().and_then(|c| match c.first {
                FirstView::Clone(block) => Some(block),
                FirstView::Remembered(..) => None,
            });
            // Only features of one view share an anchor.
            if clone.is_none() || clone != view {
                self.memory.state.camera_moved();
            }
            view = clone;
            born.push(candidate.and_then(|candidate| {
                let (first, covariance) = self.first_pose(&candidate)?;
                let (uv, by_readout) = self.first_pixel(&candidate, vague.rho);
                let common = alike.then(|| self.guess_in_common(&vague)).flatten();
                let (rho, sd) = common
                    .as_ref()
                    .map_or((vague.rho, vague.sd), |c| (c.rho, c.sd));
                let camera = &self.setup.camera;
                let mut new = NewFeature::with_prior_depth(camera, &first, &uv, sigma, rho, sd)?;
                new.seen_from_first_pose(covariance);
                match (&common, &median) {
                    (Some(common), _) => new.rho_depends_on(common.offset, &common.by),
                    (None, Some((offset, range))) => new.keep_ratio(*offset, range),
                    (None, None) => {}
                }
                let by_pixel = new.by_pixel;
                new.share_readout(&by_pixel, by_readout);
                let id = self.append_feature(&new)?.id;
                let VagueDepth { rho, sd, .. } = vague;
                self.memory.guesses.push(Guess { id, rho, sd });
                Some(id)
            }));
        }
        self.memory.state.camera_moved();
        Ok(born)
    }

    /// Forgets guesses whose features are gone, or have a known depth by now.
    fn forget_guesses(&mut self) {
        let mut guesses = std::mem::take(&mut self.memory.guesses);
        guesses.retain(|guess| {
            let block = self.memory.feature_block(guess.id);
            block.is_ok_and(|block| self.is_still(guess, &block))
        });
        self.memory.guesses = guesses;
    }

    /// Whether the depth of a feature is still that which was guessed when it was born.
    pub(crate) fn is_guess(&self, block: &Block) -> bool {
        let mut guesses = self.memory.guesses.iter();
        guesses.any(|guess| guess.id == block.id && self.is_still(guess, block))
    }

    fn is_still(&self, guess: &Guess, block: &Block) -> bool {
        let (_, own) = self.memory.state.feature_covariance(block);
        own[(5, 5)].max(0.0).sqrt() > VAGUE * guess.sd
    }

    /// What a vague depth has in common with the first of those that are there.
    fn guess_in_common(&self, vague: &VagueDepth) -> Option<CommonGuess> {
        let guess = self.memory.guesses.first()?;
        let block = self.memory.feature_block(guess.id).ok()?;
        // Nothing is farther than infinity.
        let rho = self.memory.state.feature(&block).scale();
        let off = ((rho - guess.rho) / guess.sd).max(-1.0);
        let mut by = SMatrix::zeros();
        by[5] = ALIKE * vague.sd / guess.sd;
        Some(CommonGuess {
            offset: block.offset,
            rho: vague.rho + ALIKE * off * vague.sd,
            sd: (1.0 - ALIKE * ALIKE).sqrt() * vague.sd,
            by,
        })
    }

    /// What is known of the depth of a point of which nothing is known but the scene that it is in: half the median inverse
    /// range of the landmarks of known depth, as seen from the camera, and as much. So anything from
    /// infinity to that median is within one sd, in a room as on a road, and in any unit. [`VAGUE_RHO`] where the map does not tell.
    pub(crate) fn vague_depth(&self) -> VagueDepth {
        match self.median_landmark() {
            Some((median, id)) => VagueDepth {
                rho: 0.5 * median,
                sd: 0.5 * median,
                half_of: Some(id),
            },
            None => VagueDepth {
                rho: VAGUE_RHO,
                sd: VAGUE_RHO_SD,
                half_of: None,
            },
        }
    }

    /// The landmark of known depth with the median inverse range from the camera, and that, 1/m; `None` where too few are known.
    pub(crate) fn median_landmark(&self) -> Option<(f64, u64)> {
        let largest = self.setup.settings.birth.max_rho_ratio;
        let camera = self.memory.state.camera_pose().r;
        let known = self.landmarks().into_iter();
        let known = known.filter(|landmark| landmark.rho_ratio < largest);
        let known = known.map(|l| (1.0 / (l.point - camera).norm(), l.id));
        let mut known: Vec<(f64, u64)> = known.filter(|(rho, _)| rho.is_finite()).collect();
        if known.len() < self.setup.settings.lost.min_matches {
            return None;
        }
        known.sort_unstable_by(|a, b| a.0.total_cmp(&b.0));
        Some(known[known.len() / 2])
    }

    /// The landmark that a vague depth is taken from: its offset in the state, and the derivatives of its range.
    fn median_range(&self, vague: &VagueDepth) -> Option<(usize, LogRange)> {
        let block = self.memory.feature_block(vague.half_of?).ok()?;
        let camera = self.memory.state.camera_pose().r;
        let range = LogRange::of(&camera, &self.memory.state.feature(&block))?;
        Some((block.offset, range))
    }
}
