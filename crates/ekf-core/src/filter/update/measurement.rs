//! Which rows each match gives in which mode (METHOD 7, step 5), linearised at the present mean.

use crate::filter::ekf::Filter;
use crate::filter::input::measurements::{
    Bearing, DepthObservation, MeasurementOutcome, Measurements, UpdateReport, WornObservation,
    WornPair,
};
use crate::filter::input::sources::{Scratch, Source, WornForm};
use crate::observe::block::MeasurementBlock;
use crate::observe::{ByMotion, PointInCamera, Rows};
use crate::state::Block;

/// Largest sd(range)/range with which a known feature is measured as a 3D point; a worse one gives its bearing.
const MAX_RANGE_RATIO: f64 = 0.2;

impl Filter {
    pub(crate) fn collect_blocks(
        &mut self,
        z: &Measurements,
        form: WornForm,
        newborn: &[(usize, u64)],
        report: &mut UpdateReport,
        scratch: &mut Scratch,
    ) {
        let Scratch {
            sources,
            wanted,
            with_depth,
            demoted,
            ..
        } = scratch;
        wanted.clear();
        for (i, pair) in z.pairs().iter().enumerate() {
            let born = newborn.iter().find(|(j, _)| *j == i).map(|(_, id)| *id);
            match (form, pair.id.or(born)) {
                (WornForm::Points, Some(_)) if pair.id.is_some() => wanted.push(Source::Point(i)),
                (WornForm::Tight, Some(id)) => wanted.push(Source::WornPixel(i, id)),
                _ => {}
            }
        }
        let known_depths = (0..z.depths.len()).filter(|&i| z.depths[i].id.is_some());
        wanted.extend(known_depths.map(Source::Depth));
        wanted.extend((0..z.bearings.len()).map(Source::Bearing));
        wanted.extend(self.tells_rate(z).then_some(Source::Rate));
        self.workspace.batch.clear();
        with_depth.clear();
        sources.clear();
        for &source in wanted.iter() {
            let slot = source.slot(report.pairs().len());
            if slot.is_some_and(|k| demoted[k]) {
                continue; // keeps the outcome of its rejection
            }
            // Its 3 rows stand INSTEAD of these 2: both would use (u1, v1).
            if let Source::Bearing(i) = source
                && with_depth.contains(&z.bearings[i].id)
            {
                report.bearings[i] = MeasurementOutcome::Replaced;
                continue;
            }
            let block = self.measurement_block(z, source);
            let outcome = match (&block, source) {
                (Err(outcome), _) => *outcome,
                (Ok(_), Source::Bearing(_)) => MeasurementOutcome::Pixel,
                (Ok(_), Source::Point(_) | Source::Depth(_)) => MeasurementOutcome::Depth,
                (Ok(_), Source::Rate) => MeasurementOutcome::Rate,
                (Ok(_), Source::WornPixel(i, id)) => {
                    let known = z.pairs()[i].id.is_some();
                    if known {
                        MeasurementOutcome::Pixel
                    } else {
                        MeasurementOutcome::Born(id)
                    }
                }
            };
            *source.outcome(report) = outcome;
            if let Ok(block) = block {
                if outcome == MeasurementOutcome::Depth {
                    with_depth.push(block.id);
                }
                self.workspace.batch.push(block);
                sources.push(source);
            }
        }
    }

    pub(crate) fn measurement_block(
        &self,
        z: &Measurements,
        source: Source,
    ) -> Result<MeasurementBlock, MeasurementOutcome> {
        match (source, z.first_view()) {
            (Source::Bearing(i), _) => self.bearing(&z.bearings[i]),
            (Source::Point(i), Some(worn)) => self.worn_point(worn, &worn.pairs[i]),
            (Source::WornPixel(i, id), Some(worn)) => self.worn_pixel(worn, &worn.pairs[i], id),
            (Source::Depth(i), _) => self.other_depth(&z.depths[i]),
            (Source::Rate, Some(worn)) => self.worn_rate(worn),
            (Source::Point(_) | Source::WornPixel(..) | Source::Rate, None) => {
                Err(MeasurementOutcome::Unused)
            }
        }
    }

    pub(crate) fn bearing(
        &self,
        bearing: &Bearing,
    ) -> Result<MeasurementBlock, MeasurementOutcome> {
        let landmark = self
            .memory
            .feature_block(bearing.id)
            .map_err(|_| MeasurementOutcome::NotVisible)?;
        let (pose, shutter) = (self.memory.state.camera_pose(), self.shutter());
        let rows = self.rows_at_told_depth(&landmark, &|feature| {
            Rows::bearing(
                &self.setup.camera,
                &pose,
                feature,
                &bearing.uv,
                self.setup.settings.pixel.sigma_cs,
                shutter.as_ref(),
            )
        });
        let (rows, told) = rows.ok_or(MeasurementOutcome::NotVisible)?;
        let block = MeasurementBlock::new(Some(rows), &landmark, self.memory.state.calibration())?;
        Ok(MeasurementBlock { told, ..block })
    }

    fn worn_point(
        &self,
        worn: &WornObservation,
        pair: &WornPair,
    ) -> Result<MeasurementBlock, MeasurementOutcome> {
        let id = pair.id.ok_or(MeasurementOutcome::Unused)?;
        let landmark = self
            .memory
            .feature_block(id)
            .map_err(|_| MeasurementOutcome::NotVisible)?;
        let (view, unrolled) = self
            .intersect_unrolled(worn, pair)
            .ok_or(MeasurementOutcome::NotVisible)?;
        let (pose, feature) = (
            self.memory.state.camera_pose(),
            self.memory.state.feature(&landmark),
        );
        let predicted =
            PointInCamera::metric(&pose, &feature).ok_or(MeasurementOutcome::NotVisible)?;
        let view = view.at_point(&predicted.value);
        let (sigma, sigma_f) = (
            self.setup.settings.pixel.sigma_cs,
            self.setup.settings.pixel.sigma_cf,
        );
        if self.rho_variance(worn, &view, &pair.uv_f).sqrt() > MAX_RANGE_RATIO * view.rho {
            return Err(MeasurementOutcome::TooUncertain);
        }
        let j = view.point_by_tangent();
        let by_pixel = view.point_by_pixel();
        let mut noise = view.point_noise(sigma, sigma_f);
        let error = self.worn_error_offset(worn.who);
        if error.is_none() {
            noise += j * self.worn_covariance(worn) * j.transpose();
        }
        let mean = self.memory.state.worn_error(worn.who);
        // The point was triangulated at the estimated error, so only its deviation from there counts.
        let measured = view.point() - j * mean;
        let error_of = error.map(|_| (&mean, &j));
        let rows = Rows::depth(&pose, &feature, &measured, &noise, error_of);
        let rows = rows.map(|mut rows| {
            let mut by_attitude = rows.by_pose.fixed_view_mut::<3, 4>(0, 3);
            by_attitude -= by_pixel * unrolled.by_attitude;
            rows.by_motion = unrolled.by_motion.map(|(readout, by)| ByMotion {
                readout,
                by: -(by_pixel * by),
            });
            rows.roll = self.worn_roll(worn.who, &pair.uv_f);
            rows
        });
        MeasurementBlock::new(rows, &landmark, error)
    }

    fn worn_pixel(
        &self,
        worn: &WornObservation,
        pair: &WornPair,
        id: u64,
    ) -> Result<MeasurementBlock, MeasurementOutcome> {
        let landmark = self
            .memory
            .feature_block(id)
            .map_err(|_| MeasurementOutcome::NotVisible)?;
        let camera = self.setup.worn_cameras.get(worn.who);
        let camera = camera.ok_or(MeasurementOutcome::NotVisible)?;
        let error = self.memory.state.worn_error(worn.who);
        let rows = Rows::worn_pixel(
            camera,
            (&worn.t_cf, &error),
            &self.memory.state.camera_pose(),
            &self.memory.state.feature(&landmark),
            &pair.uv_f,
            self.setup.settings.pixel.sigma_cf,
        );
        let rows = rows.map(|mut rows| {
            if let (Some(told), Some(by_error)) = (&self.workspace.told, &rows.by_shared) {
                let by_rho = rows.by_feature.column(5).into_owned();
                rows.innovation += told.expected(by_error, &by_rho, landmark.offset + 5);
            }
            rows.roll = self.worn_roll(worn.who, &pair.uv_f);
            rows
        });
        MeasurementBlock::new(rows, &landmark, self.worn_error_offset(worn.who))
    }

    fn other_depth(
        &self,
        depth: &DepthObservation,
    ) -> Result<MeasurementBlock, MeasurementOutcome> {
        let id = depth.id.ok_or(MeasurementOutcome::Unused)?;
        let landmark = self
            .memory
            .feature_block(id)
            .map_err(|_| MeasurementOutcome::NotVisible)?;
        let (point, noise) = self
            .point_at_depth(depth)
            .ok_or(MeasurementOutcome::NotVisible)?;
        let (pose, feature) = (
            self.memory.state.camera_pose(),
            self.memory.state.feature(&landmark),
        );
        MeasurementBlock::new(
            Rows::depth(&pose, &feature, &point, &noise, None),
            &landmark,
            None,
        )
    }
}

impl MeasurementBlock {
    pub(crate) fn new(
        rows: Option<Rows>,
        landmark: &Block,
        shared: Option<usize>,
    ) -> Result<Self, MeasurementOutcome> {
        let rows = rows.ok_or(MeasurementOutcome::NotVisible)?;
        Ok(Self {
            rows,
            id: landmark.id,
            feature: landmark.offset,
            shared,
            told: None,
        })
    }
}
