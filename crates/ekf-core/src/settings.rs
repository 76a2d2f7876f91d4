//! Every setting of the filter: its one default, unit, range and meaning.
//!
//! The table [`filter_settings!`] is the only owner of these facts; the Python layer, the settings file and the
//! documentation are generated from it and from [`schema`]. Each entry says who may have a reason to change it ([`Audience`]): what
//! no user has one for is a switch of the lab, which the settings file does not know, or a constant beside its formula.

mod choices;
mod value;

pub use choices::{BatchTestKind, Consistency, FirstPose, Mode, MotionModel, WornErrors};
pub use value::{Audience, SettingInfo, Value};

use crate::error::EkfError;
use Audience::{Lab, User};
use nalgebra::{Matrix2, Matrix6, Vector2, Vector6};
use value::Setting;

macro_rules! define {
    ($( $(#[doc = $gdoc:literal])+ $group:ident: $gtype:ident {
        $( $(#[doc = $doc:literal])+ $field:ident: $ty:ty = $default:expr, $unit:literal, $min:expr, $max:expr, $audience:expr; )*
    } )*) => {
        $(
            $(#[doc = $gdoc])+
            #[derive(Clone, Debug, PartialEq)]
            pub struct $gtype {
                $( $(#[doc = $doc])+ pub $field: $ty, )*
            }
            impl Default for $gtype {
                fn default() -> Self { Self { $( $field: $default, )* } }
            }
        )*

        /// All settings of the filter.
        #[derive(Clone, Debug, Default, PartialEq)]
        pub struct Settings {
            $( $(#[doc = $gdoc])+ pub $group: $gtype, )*
        }

        /// Every setting in the order of the file.
        pub fn schema() -> Vec<SettingInfo> {
            let defaults = Settings::default();
            vec![ $( $( SettingInfo {
                key: concat!(stringify!($group), ".", stringify!($field)).into(),
                kind: <$ty as Setting>::KIND,
                default: Setting::to_value(&defaults.$group.$field),
                min: $min,
                max: $max,
                unit: $unit,
                choices: <$ty as Setting>::CHOICES,
                doc: [$($doc),+].map(str::trim).join(" "),
                audience: $audience,
            }, )* )* ]
        }

        impl Settings {
            /// Every value by its dotted key, in the order of [`schema`].
            pub fn values(&self) -> Vec<(String, Value)> {
                vec![ $( $( (
                    concat!(stringify!($group), ".", stringify!($field)).into(),
                    Setting::to_value(&self.$group.$field),
                ), )* )* ]
            }

            /// Settings of what [`Self::values`] gave.
            ///
            /// # Errors
            /// `InvalidSetting` if a key is missing or unknown, or a value is impossible.
            pub fn from_values(values: &[(String, Value)]) -> Result<Self, EkfError> {
                let mut settings = Self::default();
                let keys = settings.values().into_iter().map(|(key, _)| key);
                if let Some(key) = keys.into_iter().find(|key| values.iter().all(|(k, _)| k != key)) {
                    return Err(EkfError::InvalidSetting { key, why: "it is missing".into() });
                }
                for (key, value) in values {
                    settings.set(key, value)?;
                }
                Ok(settings)
            }

            /// Sets one value by its dotted key, a switch of the lab's as well.
            ///
            /// # Errors
            /// `InvalidSetting` for an unknown key, a wrong type or a value out of range.
            pub fn set(&mut self, key: &str, value: &Value) -> Result<(), EkfError> {
                let invalid = |why: String| EkfError::InvalidSetting { key: key.into(), why };
                match key {
                    $( $( concat!(stringify!($group), ".", stringify!($field)) =>
                        self.$group.$field = Setting::from_value(value, $min, $max).map_err(invalid)?, )* )*
                    _ => return Err(invalid("there is no such setting".into())),
                }
                Ok(())
            }
        }
    };
}

/// Mean and standard deviation of a readout that lies evenly between 0 and a thirtieth of a second: `1 / 60` and
/// `1 / (30 sqrt(12))`.
const UNTOLD_READOUT: (f64, f64) = (1.0 / 60.0, 0.009622504486493764);

/// The table of all settings, handed to the macro of this name: groups of `name: type = default, unit, least, largest,
/// audience`.
#[macro_export]
macro_rules! filter_settings {
    ($macro:ident) => { $macro! {
    /// Which estimator.
    estimator: EstimatorSettings {
        /// What the worn camera is used for and how features are born.
        mode: Mode = Mode::CollabTight, "", None, None,
            User("Take mono to see what the worn camera adds, collab to use it as the paper does.");
        /// What keeps the filter from gaining information that no measurement holds: gauge (the covariance moves with
        /// rotation and scale, the directions that no camera can see) or none (the plain EKF).
        consistency: Consistency = Consistency::Gauge, "", None, None, Lab;
    }
    /// The motion model: constant velocity with white acceleration (METHOD 3).
    process: ProcessSettings {
        /// Whether the velocity is constant in W, or along the camera's own axes, as on a robot with wheels.
        velocity: MotionModel = MotionModel::World, "", None, None,
            User("Take body for a camera on wheels or rails, whose velocity turns with it in a bend.");
        /// Spectral density (its root) of the camera's random acceleration.
        acceleration_density: f64 = 1.0, "m/s^1.5", Some(0.0), Some(1e3),
            User("Raise it where features are lost in motion jerkier than a hand's; lower it for a smooth, slow robot.");
        /// The same of its angular acceleration.
        angular_acceleration_density: f64 = 2.0, "rad/s^1.5", Some(0.0), Some(1e3),
            User("Raise it where the camera is turned abruptly; lower it on a mount that turns smoothly.");
        /// Standard deviation of each component of the velocity at the start; ten times the median range a second at most.
        start_velocity_sd: f64 = 10.0, "m/s", Some(0.0), Some(1e3),
            User("Lower it where the camera starts slowly or at rest, which makes the first searches smaller.");
        /// Standard deviation of each component of the angular velocity at the start.
        start_angular_velocity_sd: f64 = 1.0, "rad/s", Some(0.0), Some(1e2), Lab;
        /// How much of the error that landmarks in view share shows in their innovations: a new view stands beside an old one
        /// with this many times the part of the innovations that is beyond a patch's own noise, by angle (METHOD 20); 0 for
        /// errors that are as the noise of the pixels says.
        map_drift: f64 = 14.0, "", Some(0.0), Some(100.0), Lab;
    }
    /// Odometry as motion input (METHOD 23).
    odometry: OdometrySettings {
        /// Standard deviation of the scale of its translation, relative: of a wheel's radius, and of the slip that lasts.
        scale_sd: f64 = 0.05, "", Some(0.0), Some(1.0),
            User("Lower it to 0.01 for well calibrated wheels on a hard floor, raise it for soft ground; 0 takes the scale as exact.");
        /// The same of its turns.
        turn_scale_sd: f64 = 0.05, "", Some(0.0), Some(1.0),
            User("Raise it for skid steering, lower it where a gyroscope measures the turns.");
        /// For how long such an error lasts.
        scale_time: f64 = 30.0, "s", Some(0.1), Some(1e6),
            User("Lower it to some seconds where the ground changes often, raise it where only the wheels' radius is uncertain.");
    }
    /// A gyroscope, and an accelerometer beside it, as motion input (METHOD 28): what their data sheet or an Allan variance says.
    imu: ImuSettings {
        /// Spectral density (its root) of the white noise of the gyroscope's rates.
        gyro_noise: f64 = 0.001, "rad/s^0.5", Some(1e-7), Some(1.0),
            User("Set it as the sensor's calibration says, doubled; a phone's is 0.001, a good one's 0.0002.");
        /// Standard deviation of the gyroscope's bias along each axis at the start.
        gyro_bias_sd: f64 = 0.05, "rad/s", Some(0.0), Some(1.0),
            User("Lower it to 0.01 for a sensor whose bias was taken off at rest: the first turns are then known better.");
        /// Spectral density (its root) of the walk of that bias.
        gyro_bias_walk: f64 = 1e-4, "rad/s^1.5", Some(0.0), Some(1.0),
            User("Set it as the sensor's calibration says; raise it where the sensor warms up.");
        /// Standard deviation of the gyroscope's scale, relative. It is considered, not estimated.
        gyro_scale_sd: f64 = 0.005, "", Some(0.0), Some(0.5),
            User("Raise it to 0.02 for a bare sensor that nobody has calibrated.");
        /// Standard deviation of each of the three angles of the sensor's mounting. It is considered, not estimated.
        mount_sd: f64 = 0.00872665, "rad", Some(0.0), Some(0.5),
            User("Lower it to 0.002 where a calibration with a board told the mounting, raise it to 0.05 where it is known by eye.");
        /// Standard deviation of what is left of the offset between the clocks of the sensor and of Cs.
        time_offset_sd: f64 = 0.005, "s", Some(0.0), Some(0.5),
            User("Set it to 0 where one clock stamps both, raise it to 0.03 where images are stamped as they arrive.");
        /// Spectral density (its root) of the white noise of the accelerometer.
        accel_noise: f64 = 0.01, "m/s^1.5", Some(1e-6), Some(10.0),
            User("Set it as the sensor's calibration says.");
        /// Standard deviation of the accelerometer's bias along each axis.
        accel_bias_sd: f64 = 0.2, "m/s^2", Some(0.0), Some(10.0),
            User("Lower it for a calibrated sensor: a level map is as level as this says, 0.2 m/s^2 are 1.2 degrees.");
    }
    /// How well Cs is calibrated. A calibration's error is the same in every frame, so that no number of features averages it
    /// out: the filter considers it and does not estimate it, but for the readout (METHOD 4). All zero: the calibration is exact.
    calibration: CalibrationSettings {
        /// Standard deviation of the focal length, relative.
        focal_sd: f64 = 0.0, "", Some(0.0), Some(0.5),
            User("State what your calibration says of itself: 0.003 is a good one, 0.01 one out of a data sheet.");
        /// Standard deviation of the ratio of both focal lengths.
        aspect_sd: f64 = 0.0, "", Some(0.0), Some(0.5),
            User("As the focal length's; pixels are square to 0.001.");
        /// Standard deviation of each coordinate of the principal point.
        centre_sd: f64 = 0.0, "px", Some(0.0), Some(1e3),
            User("As the focal length's; some pixels, unless it was calibrated well.");
        /// Standard deviation of the radial distortion: of its coefficients of the third and the fifth power.
        radial_sd: f64 = 0.0, "", Some(0.0), Some(1.0),
            User("As the focal length's; 0.01 is a good lens that was calibrated well.");
        /// Time from the first row of an image of Cs to the last one: 0 for a global shutter, negative for an image upside down.
        /// The filter estimates it from here. The default is that of a shutter of which nothing is told: it may take its rows all at
        /// once, or one after the other until the next image of 30 a second, or evenly anything between.
        readout: f64 = UNTOLD_READOUT.0, "s", Some(-0.2), Some(0.2),
            User("Set it where the sensor's data sheet says so: 0.01 to 0.033 for phones and webcams, whose shutters roll; 0, and readout_sd 0, for a global shutter.");
        /// Standard deviation of that time; 0 where it is exact.
        readout_sd: f64 = UNTOLD_READOUT.1, "s", Some(0.0), Some(0.2),
            User("Set it to 0.002 beside a readout that is known, to 0 beside readout 0 for a global shutter.");
    }
    /// Noise of pixel measurements (METHOD 4).
    pixel: PixelSettings {
        /// Standard deviation of a feature's measured pixel in Cs, per axis.
        sigma_cs: f64 = 1.0, "px", Some(0.01), Some(100.0),
            User("Raise it for a blurred or poorly calibrated Cs, lower it for a sharp and well calibrated one, until NIS per degree of freedom is near 1.");
        /// Standard deviation of a matched pixel in Cf, per axis.
        sigma_cf: f64 = 1.0, "px", Some(0.01), Some(100.0),
            User("Raise it for a blurred, poorly calibrated or high-resolution Cf, where matches are off by more pixels.");
    }
    /// How features are born (METHOD 5).
    birth: BirthSettings {
        /// How the pose of a candidate's first view is treated at a delayed birth.
        first_pose: FirstPose = FirstPose::Clone, "", None, None, Lab;
        /// Least distance between first and present view for a delayed birth.
        min_baseline: f64 = 0.02, "m", Some(0.0), Some(100.0), Lab;
        /// Least parallax for a delayed birth.
        min_parallax: f64 = 1.0, "deg", Some(0.1), Some(90.0),
            User("Lower it where everything in view is far away, so that features are born before they leave the view.");
        /// Largest sd(rho)/rho of a birth from two views; while it is larger the candidate waits.
        max_rho_ratio: f64 = 0.3333333333333333, "", Some(0.01), Some(10.0), Lab;
        /// Inverse depth of an undelayed birth.
        undelayed_rho: f64 = 0.5, "1/m", Some(1e-3), Some(1e3), Lab;
        /// Standard deviation of the inverse depth of an undelayed birth.
        undelayed_rho_sd: f64 = 0.5, "1/m", Some(1e-3), Some(1e3), Lab;
        /// Where fewer features than this share of `map.in_view` are tracked, as in a turn, waiting candidates are born with a
        /// vague inverse depth from their first view. 0 for never. In mono never in metres, as the scale would come from that prior,
        /// and in an arbitrary unit only below twice `lost.min_matches`.
        vague_below: f64 = 0.6, "", Some(0.0), Some(1.0), Lab;
    }
    /// The worn camera Cf and the error of its pose (METHOD 6).
    worn: WornSettings {
        /// How the error of T_CF enters the matches of a frame.
        errors: WornErrors = WornErrors::Shared, "", None, None, Lab;
        /// Share of T_CF's stated variance that lasts (Gauss-Markov, along the axes of Cs) and is another error in each overlap, where
        /// the worn view itself does not say which part of its covariance lasts; the rest is white noise.
        bias_share: f64 = 0.9, "", Some(0.0), Some(1.0),
            User("Set it to 0 where the errors of T_CF are known to be independent from frame to frame.");
        /// Standard deviation of the logarithm of T_CF's lengths, an error for good, where the worn view itself says which part of its
        /// covariance lasts, or a bias_share of 0 that none does, and that part is less: no device knows its scale better (METHOD 6).
        length_sd: f64 = 0.01, "", Some(0.0), Some(1.0),
            User("Set it to what a device is known to have, 0.001 for motion capture; 0 for what has no error of scale, as in a simulation.");
        /// Time constant of what lasts, within an overlap.
        bias_time: f64 = 10.0, "s", Some(0.01), Some(1e6),
            User("Set it to how long an error of T_CF lasts, as its source states.");
        /// Share of T_CF's error, of its variance along the axes of Cs, that all worn cameras have in common in a frame, as where
        /// one tracker locates them all.
        common_share: f64 = 0.0, "", Some(0.0), Some(1.0),
            User("Raise it where one tracker locates several worn cameras: to the share of T_CF's error that is that of its place for Cs.");
        /// How late a view of Cf may come and still be used: for so long the poses of Cs are kept once views come that are
        /// not of a frame's own instant (METHOD 21).
        late: f64 = 1.0, "s", Some(0.05), Some(10.0),
            User("Raise it for a slow link between the cameras; poses are then kept farther apart and cost the same.");
        /// A view taken this close to a frame counts as one of its instant; the motion of Cs meanwhile is added to the noise
        /// of T_CF.
        tolerance: f64 = 0.001, "s", Some(0.0), Some(0.1),
            User("Raise it to the jitter of the stamps where a trigger makes both cameras take their images together.");
        /// Standard deviation of the offset, the same in all views, of a worn camera's time stamps against the clock of Cs. Views
        /// that come between frames and see Cs change its motion tell it; until then it counts as an error of T_CF that lasts.
        clock_sd: f64 = 0.0, "s", Some(0.0), Some(1.0),
            User("Set it to how well the two clocks agree: 0.001 with PTP, 0.005 with NTP over a good link.");
        /// Time from the first row of an image of Cf to the last one, root mean square of what it may be. Meanwhile its wearer moves and
        /// turns, by 1 m/s and 1 rad/s on each axis (standard deviations), and each row sees another T_CF (METHOD 6). 0 for a shutter
        /// that does not roll.
        readout: f64 = 0.0192, "s", Some(0.0), Some(0.1),
            User("Set it to the worn camera's readout where that is known, to 0 for a global shutter.");
        /// Standard deviation of that time, a part of its root mean square. It counts where a gyroscope of Cf tells how that turned.
        readout_sd: f64 = 0.0096, "s", Some(0.0), Some(0.1),
            User("Set it to 0.002 beside a readout of Cf that is known, so that a gyroscope of its own tells how its rows turn.");
        /// Standard deviation of the rate, on each axis, that a gyroscope of Cf tells of an image: of its bias, scale and mounting, of
        /// its clock, and of how the rate changes while the image is read.
        rate_sd: f64 = 0.1, "rad/s", Some(1e-3), Some(10.0),
            User("Lower it to 0.05 where one clock stamps images and rates of Cf, raise it to 0.3 where they are 20 ms apart.");
        /// Least number of births that starts the filter from a first overlap.
        start_births: usize = 8, "", Some(1.0), Some(1000.0),
            User("Lower it where the two cameras share too little texture for a run to start.");
    }
    /// Validation of a frame's matches (METHOD 8).
    validate: ValidateSettings {
        /// Which test of the whole batch.
        test: BatchTestKind = BatchTestKind::Hohct, "", None, None, Lab;
        /// Confidence level of the chi-square tests.
        level: f64 = 0.95, "", Some(0.5), Some(0.999999),
            User("Raise it where correct matches are rejected although the noise sizes are right; lower it where much moves.");
        /// Level of the gate for each match given all the others, after the batch test; 1 for none.
        conditional_level: f64 = 0.9999, "", Some(0.5), Some(1.0), Lab;
        /// Largest number of hypotheses of a batch test. Past it the best set so far stands, and the frame's report says so.
        /// One takes about 0.15 ms for 100 matches and a tenth of that for 40, and a frame is tested up to three times.
        max_nodes: usize = 100, "", Some(1.0), Some(1e9), Lab;
    }
    /// Upkeep of the map (METHOD 7, step 8).
    map: MapSettings {
        /// Number of features that the map keeps in view.
        in_view: usize = 40, "", Some(4.0), Some(1000.0),
            User("Lower it for a slower computer, raise it for accuracy; the time for a frame grows faster than its square.");
        /// Candidates tracked beside them, as a share of that number: births take time, and not every candidate is born.
        reserve: f64 = 0.6, "", Some(0.0), Some(10.0), Lab;
        /// Largest number of features in the map.
        max_features: usize = 120, "", Some(4.0), Some(10000.0),
            User("Raise it to remember more of a larger place; memory and time grow with its square.");
        /// Size of the map from which features out of view are updated only when they come back into view or somebody asks
        /// for the whole state: the same result, faster for large maps.
        local_from: usize = 150, "", Some(0.0), Some(1e9), Lab;
        /// A candidate that has not been born after so many seconds is dropped.
        candidate_age: f64 = 4.0, "s", Some(0.01), Some(1e4), Lab;
    }
    /// When the camera counts as lost.
    lost: LostSettings {
        /// Accepted matches that a frame needs to be OK, and a lost camera to be found. Each gives two equations for the six
        /// numbers of the pose, so 8 leave ten to check it.
        min_matches: usize = 8, "", Some(4.0), Some(1000.0),
            User("Raise it where a wrong pose costs more than a lost one; lower it where little is in view.");
        /// The camera is lost after this long without an OK frame, or after three failed frames in a row.
        seconds: f64 = 1.0, "s", Some(0.0), Some(3600.0),
            User("Raise it at a low frame rate or where images arrive with pauses; lower it where the camera moves fast.");
    }
    /// Prediction of the overlap of both views (METHOD 9).
    overlap: OverlapSettings {
        /// Least depth at which either camera is taken to see anything.
        near: f64 = 0.3, "m", Some(0.001), Some(100.0),
            User("Lower it to map nearer things, as on a table.");
        /// Largest depth at which Cf is used.
        far: f64 = 60.0, "m", Some(0.1), Some(1e5),
            User("Raise it outdoors where Cf is far from Cs, so that distant things help; lower it indoors to search less.");
    }
    } };
}

filter_settings!(define);

impl CalibrationSettings {
    /// The readout of Cs and its standard deviation, seconds; `None` for a shutter that is known not to roll.
    pub fn readout(&self) -> Option<(f64, f64)> {
        let rolls = self.readout != 0.0 || self.readout_sd > 0.0;
        rolls.then_some((self.readout, self.readout_sd))
    }

    /// Whether more is told of the readout than that it is no longer than most cameras take for an image.
    pub fn is_readout_told(&self) -> bool {
        self.readout_sd < UNTOLD_READOUT.1
    }

    /// Where the readout lies of which nothing is told at all; `None` where something is.
    pub(crate) fn possible_readouts(&self) -> Option<(f64, f64)> {
        let untold = (self.readout, self.readout_sd) == UNTOLD_READOUT;
        untold.then_some((0.0, 2.0 * UNTOLD_READOUT.0))
    }

    /// Covariance of the calibration's error, in the order of the camera's `warp_jacobian`;
    /// `None` where it is exact.
    pub fn covariance(&self) -> Option<Matrix6<f64>> {
        let (focal, aspect, centre, radial) = (
            self.focal_sd,
            self.aspect_sd,
            self.centre_sd,
            self.radial_sd,
        );
        let sds = Vector6::new(focal, aspect, centre, centre, radial, radial);
        (sds.max() > 0.0).then(|| Matrix6::from_diagonal(&sds.component_mul(&sds)))
    }
}

impl WornSettings {
    /// The readout of Cf and its standard deviation, seconds.
    pub fn readout_told(&self) -> (f64, f64) {
        let sd = self.readout_sd.min(self.readout);
        ((self.readout.powi(2) - sd * sd).sqrt(), sd)
    }
}

impl OdometrySettings {
    /// Covariance of the errors of both scales; `None` where they are exact.
    pub fn covariance(&self) -> Option<Matrix2<f64>> {
        let sds = Vector2::new(self.scale_sd, self.turn_scale_sd);
        (sds.max() > 0.0).then(|| Matrix2::from_diagonal(&sds.component_mul(&sds)))
    }
}
