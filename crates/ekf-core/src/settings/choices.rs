//! Settings that are one of a list of names.

use super::value::{Setting, Value};

macro_rules! choice {
    ($(#[$doc:meta])* $name:ident { $first:ident = $first_text:literal $(, $(#[$vdoc:meta])* $variant:ident = $text:literal)* $(,)? } $first_doc:literal) => {
        $(#[$doc])*
        #[derive(Clone, Copy, Debug, PartialEq, Eq)]
        pub enum $name {
            #[doc = $first_doc]
            $first,
            $($(#[$vdoc])* $variant,)*
        }
        impl $name {
            /// The name used in settings.
            pub const fn name(self) -> &'static str {
                match self { Self::$first => $first_text, $(Self::$variant => $text,)* }
            }
        }
        impl Setting for $name {
            const KIND: &'static str = "enum";
            const CHOICES: &'static [&'static str] = &[$first_text, $($text),*];
            fn to_value(&self) -> Value { Value::Name(self.name().into()) }
            fn from_value(value: &Value, _: Option<f64>, _: Option<f64>) -> Result<Self, String> {
                match value {
                    Value::Name(s) if s == $first_text => Ok(Self::$first),
                    $(Value::Name(s) if s == $text => Ok(Self::$variant),)*
                    _ => Err(format!("must be one of {}", Self::CHOICES.join(", "))),
                }
            }
        }
    };
}

choice! {
    /// What the worn camera is used for, and how features without it are born (METHOD 5, 6).
    Mode {
        Mono = "mono",
        /// As `mono`, but features are born at first sight with a vague depth.
        MonoUndelayed = "mono-undelayed",
        /// The worn camera only starts features (the paper's predecessor).
        CollabInit = "collab-init",
        /// The worn camera starts features and measures known ones as 3D points (the paper).
        Collab = "collab",
        /// The worn camera's pixels are measured, its pose being part of the state for the frame.
        CollabTight = "collab-tight",
    }
    "No worn camera after the start; features are born delayed, from parallax."
}

choice! {
    /// What stays as it is when nothing accelerates the camera (METHOD 3).
    MotionModel {
        World = "world",
        /// Its velocity along its own axes, as on wheels, which turns with it in a bend.
        Body = "body",
    }
    "Its velocity in W, as of something that is free to turn about itself."
}

choice! {
    /// How the pose of a candidate's first view is treated at its delayed birth (METHOD 5).
    FirstPose {
        Clone = "clone",
        /// Remembered with its covariance, as if independent of today's pose (the paper).
        Independent = "independent",
    }
    "Kept in the state, so its correlation with today's pose is exact."
}

choice! {
    /// How the error of T_CF enters the matches of one frame (METHOD 5, 6).
    WornErrors {
        Shared = "shared",
        /// Each match has an error of its own (the paper): overconfident.
        Independent = "independent",
        /// Only the pixels err, T_CF is taken as exact (the paper's predecessor): more so.
        Pixels = "pixels",
    }
    "One error common to all matches of the frame."
}

choice! {
    /// What keeps the filter from gaining information that no measurement holds (METHOD 14).
    Consistency {
        Gauge = "gauge",
        /// The plain EKF.
        None = "none",
    }
    "The covariance moves with the directions that no camera can see: rotation and scale."
}

choice! {
    /// How a batch of matches is validated (METHOD 8).
    BatchTestKind {
        Hohct = "hohct",
        /// Joint compatibility branch and bound.
        Jcbb = "jcbb",
        /// One-point hypotheses.
        OnePoint = "one-point",
        /// Each match by itself.
        Individual = "individual",
        /// No test.
        None = "none",
    }
    "Highest order hypothesis compatibility test."
}

impl Mode {
    /// Whether Cf is used after the filter has started.
    pub const fn uses_worn(self) -> bool {
        matches!(self, Self::CollabInit | Self::Collab | Self::CollabTight)
    }
}
