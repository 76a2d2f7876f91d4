//! A calibration as other programs name and shape its numbers: ROS's `CameraInfo`, Kalibr, OpenCV.

use crate::arrays_in::{Argument, numbers};
use crate::errors::invalid;
use pyo3::prelude::*;
use pyo3::types::PyDict;

/// What else may be said of a camera: `K`, `k`, `D`, `d`, `distortion_model`, `distortion_coeffs`, `camera_model`
/// and `resolution`, as ROS and Kalibr have them.
///
/// Python: ArrayLike
pub(crate) type OtherNames<'py> = Bound<'py, PyDict>;

/// Our model of distortion by each name that it has elsewhere, in lower case.
pub(crate) const MODELS: [(&str, &str); 18] = [
    ("", "pinhole"),
    ("none", "pinhole"),
    ("pinhole", "pinhole"),
    ("rectified", "pinhole"),
    ("brown", "radtan"),
    ("brown_conrady", "radtan"),
    ("opencv", "radtan"),
    ("plumb_bob", "radtan"),
    ("radial-tangential", "radtan"),
    ("radial_tangential", "radtan"),
    ("radtan", "radtan"),
    ("rational_polynomial", "radtan"),
    ("equi", "fisheye"),
    ("equidistant", "fisheye"),
    ("fisheye", "fisheye"),
    ("kannala_brandt", "fisheye"),
    ("kannalabrandt8", "fisheye"),
    ("wideangle", "wideangle"),
];

const NEEDED: &str = "give a model, width and height, and intrinsics (fx, fy, cx, cy or the matrix K): \
    Camera('radtan', 640, 480, K, D), or by the names of ROS or Kalibr";

/// The arguments of a camera, each maybe under another name.
pub(crate) struct Given<'a, 'py> {
    pub(crate) model: Option<Argument<'py>>,
    pub(crate) size: [Option<Argument<'py>>; 2],
    pub(crate) intrinsics: Option<Argument<'py>>,
    pub(crate) distortion: Option<Argument<'py>>,
    pub(crate) others: Option<&'a OtherNames<'py>>,
}

impl<'py> Given<'_, 'py> {
    /// `model, width, height, intrinsics, distortion` as the core takes them; `InputError` for anything else.
    pub(crate) fn read(self) -> PyResult<(String, u32, u32, [f64; 4], Vec<f64>)> {
        const KNOWN: [&str; 8] = [
            "K",
            "k",
            "D",
            "d",
            "distortion_model",
            "distortion_coeffs",
            "camera_model",
            "resolution",
        ];
        for (name, _) in self.others.into_iter().flatten() {
            let name: String = name.extract()?;
            if !KNOWN.contains(&name.as_str()) {
                let why = format!("there is no argument `{name}`; {NEEDED}");
                return Err(invalid("camera", why));
            }
        }
        let distortion = match self.one(&self.distortion, &["D", "d", "distortion_coeffs"])? {
            Some(given) => flat("camera distortion", &given)?,
            None => Vec::new(),
        };
        let model = self.model(distortion.iter().all(|k| *k == 0.0))?;
        let intrinsics = self
            .one(&self.intrinsics, &["K", "k"])?
            .ok_or_else(|| invalid("camera intrinsics", format!("there are none; {NEEDED}")))?;
        let [width, height] = self.size()?;
        let lens = without_padding(&model, distortion);
        Ok((model, width, height, focal(&intrinsics)?, lens))
    }

    /// An argument under whichever name it was given; an error if under two.
    fn one(
        &self,
        own: &Option<Argument<'py>>,
        names: &[&'static str],
    ) -> PyResult<Option<Argument<'py>>> {
        let mut found = own.clone();
        for name in names {
            if let Some(value) = self.other(name)? {
                if found.is_some() {
                    return Err(invalid(
                        "camera",
                        format!("`{name}` was given beside another name of the same; give one"),
                    ));
                }
                found = Some(value);
            }
        }
        Ok(found.filter(|value| !value.is_none()))
    }

    fn other(&self, name: &str) -> PyResult<Option<Argument<'py>>> {
        self.others.map_or(Ok(None), |others| others.get_item(name))
    }

    /// The model by our name, or as it was given where it is none that is known.
    fn model(&self, bare: bool) -> PyResult<String> {
        let text = |value: Argument<'py>| {
            value.extract::<String>().map_err(|_| {
                let given = value
                    .repr()
                    .map_or_else(|_| String::new(), |r| r.to_string());
                invalid(
                    "camera model",
                    format!("a name is needed, not {given:.40}; {NEEDED}"),
                )
            })
        };
        if let Some(kind) = self.other("camera_model")? {
            let kind = text(kind)?;
            if kind != "pinhole" {
                let why = format!(
                    "Kalibr's `{kind}` is none of ours; collabslam.datasets.load_camera reads its file"
                );
                return Err(invalid("camera model", why));
            }
        }
        match self.one(&self.model, &["distortion_model"])? {
            Some(given) => {
                let name = text(given)?;
                let lower = name.trim().to_lowercase();
                let ours = MODELS.iter().find(|(theirs, _)| *theirs == lower);
                Ok(ours.map_or(name, |(_, ours)| (*ours).into()))
            }
            None if bare => Ok("pinhole".into()),
            None => Err(invalid(
                "camera model",
                "there is distortion and no model; give distortion_model, as 'radtan'",
            )),
        }
    }

    fn size(&self) -> PyResult<[u32; 2]> {
        let wrong = || {
            invalid(
                "camera image size",
                format!("whole pixels are needed; {NEEDED}"),
            )
        };
        if let Some(size) = self.other("resolution")? {
            if self.size.iter().any(Option::is_some) {
                return Err(invalid(
                    "camera image size",
                    "there are width or height beside the resolution; give one of them",
                ));
            }
            return size.extract().map_err(|_| wrong());
        }
        match &self.size {
            [Some(width), Some(height)] => Ok([
                width.extract().map_err(|_| wrong())?,
                height.extract().map_err(|_| wrong())?,
            ]),
            _ => Err(wrong()),
        }
    }
}

/// Numbers of an array of any shape, row by row.
fn flat(what: &'static str, value: &Argument<'_>) -> PyResult<Vec<f64>> {
    let ravelled = value.py().import("numpy")?.call_method1("ravel", (value,));
    let row = ravelled.map_err(|_| invalid(what, "an array of numbers is needed"))?;
    numbers(what, &row)
}

/// `fx, fy, cx, cy` of four numbers, or of the matrix K.
fn focal(value: &Argument<'_>) -> PyResult<[f64; 4]> {
    let what = "camera intrinsics";
    match flat(what, value)?[..] {
        [fx, fy, cx, cy] => Ok([fx, fy, cx, cy]),
        [fx, skew, cx, below, fy, cy, a, b, c] if [below, a, b, c] == [0.0, 0.0, 0.0, 1.0] => {
            if skew.abs() > 1e-3 * fx.abs() {
                let why = format!("K has a skew of {skew}; calibrate without one");
                return Err(invalid(what, why));
            }
            Ok([fx, fy, cx, cy])
        }
        [_, _, _, _, _, _, _, _, _] => Err(invalid(
            what,
            "the last row of K is not 0 0 1; give it row by row (MATLAB's is transposed)",
        )),
        _ => Err(invalid(
            what,
            "fx, fy, cx, cy or the 3x3 matrix K are needed",
        )),
    }
}

/// Without the zeros that some write behind the parameters that a model has.
fn without_padding(model: &str, mut lens: Vec<f64>) -> Vec<f64> {
    let counts: &[usize] = match model {
        "pinhole" => &[0],
        "radtan" => &[4, 5, 8],
        "fisheye" => &[4],
        _ => return lens,
    };
    while lens.last() == Some(&0.0) && !counts.contains(&lens.len()) {
        lens.pop();
    }
    lens
}
