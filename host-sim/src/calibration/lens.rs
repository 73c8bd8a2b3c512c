//! Lenses: how far from the axis a ray meets the sensor.

use std::fmt;

use anyhow::{Result, anyhow, bail, ensure};
use glam::DVec2;

/// Tangent of the largest angle from the axis, 85 degrees, that a plane view is made of.
pub(super) const TANGENT_MAX: f64 = 11.43;

/// A lens model with its coefficients, on rays by their tangents `x / z` and `y / z`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Lens {
    model: Model,
    /// The largest tangent up to which rays further out meet the sensor further out; beyond, the
    /// polynomials of a model fold the scene back into the picture, which no lens does.
    reach: f64,
}

/// The models that are computed.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Model {
    /// Radial and tangential distortion: `k1 k2 p1 p2 k3 k4 k5 k6` in the order of OpenCV and ROS.
    /// The last three are 0 but in the rational model, and all are 0 without distortion.
    RadialTangential([f64; 8]),
    /// The model of Kannala and Brandt for fisheye lenses, `k1 k2 k3 k4`: `equidistant` in ROS and
    /// Kalibr, `fisheye` in OpenCV.
    Equidistant([f64; 4]),
}

impl Lens {
    /// A lens from a model and its coefficients.
    #[must_use]
    pub fn new(model: Model) -> Self {
        let mut lens = Self {
            model,
            reach: TANGENT_MAX,
        };
        let steps = 4000;
        let tangent = |step: i32| (f64::from(step) / f64::from(steps) * TANGENT_MAX.atan()).tan();
        let mut last = 0.0;
        for step in 1..=steps {
            let radius = lens.radius(tangent(step));
            // A radius that is no number ends the reach as well.
            if radius.is_nan() || radius <= last {
                lens.reach = tangent(step - 1);
                break;
            }
            last = radius;
        }
        lens
    }

    /// Checks that a file names a pinhole as its projection, before the distortion.
    ///
    /// # Errors
    /// Fails with the reason when it is another one.
    pub fn ensure_pinhole(name: &str) -> Result<()> {
        if name == "pinhole" {
            Ok(())
        } else {
            Err(not_computed(name))
        }
    }

    /// A lens by the name of its model in a file, in any of the usual spellings.
    ///
    /// # Errors
    /// Fails with the reason when the model is not one that is computed, or the number of
    /// coefficients is not one that it can have.
    pub fn named(name: &str, coefficients: &[f64]) -> Result<Self> {
        let plain: String = name
            .chars()
            .filter(char::is_ascii_alphanumeric)
            .map(|letter| letter.to_ascii_lowercase())
            .collect();
        match plain.as_str() {
            "plumbbob"
            | "rational"
            | "rationalpolynomial"
            | "radtan"
            | "radialtangential"
            | "pinholeradialtangential"
            | "brownconrady" => Self::radial_tangential(coefficients),
            "equidistant" | "equi" | "fisheye" | "kannalabrandt" | "kb4" => {
                let Ok(four) = coefficients.try_into() else {
                    bail!(
                        "the model {name} has 4 coefficients, not {}",
                        coefficients.len()
                    );
                };
                Ok(Self::new(Model::Equidistant(four)))
            }
            "none" | "" | "pinhole" => {
                let is_plain = coefficients.iter().all(|&k| k == 0.0);
                ensure!(is_plain, "distortion coefficients without a lens model");
                Self::radial_tangential(&[])
            }
            _ => Err(not_computed(name)),
        }
    }

    /// A lens of OpenCV's order: 0, 4, 5 or 8 coefficients; or 12 or 14, of which those of the thin
    /// prism and the tilt must be 0.
    ///
    /// # Errors
    /// Fails with the reason when the coefficients are of another number, or a prism or a tilt is
    /// not 0.
    pub fn radial_tangential(coefficients: &[f64]) -> Result<Self> {
        let count = coefficients.len();
        ensure!(
            matches!(count, 0 | 4 | 5 | 8 | 12 | 14),
            "{count} distortion coefficients; radial-tangential models have 4, 5 or 8"
        );
        let (radial, rest) = coefficients.split_at(count.min(8));
        ensure!(
            rest.iter().all(|&k| k == 0.0),
            "the lens model thin prism (12 and 14 coefficients) {NOT_COMPUTED}"
        );
        let mut eight = [0.0; 8];
        for (to, from) in eight.iter_mut().zip(radial) {
            *to = *from;
        }
        Ok(Self::new(Model::RadialTangential(eight)))
    }

    /// The model and its coefficients.
    #[must_use]
    pub fn model(&self) -> Model {
        self.model
    }

    /// Whether the model holds for a ray, by its tangents.
    #[must_use]
    pub fn reaches(&self, tangents: DVec2) -> bool {
        tangents.length() <= self.reach
    }

    /// Where a ray meets the sensor, relative to the axis, in focal lengths. A ray out of reach
    /// meets it where the outermost of its direction does.
    #[must_use]
    pub fn distort(&self, tangents: DVec2) -> DVec2 {
        let at = tangents.clamp_length_max(self.reach);
        let distance = at.length();
        let scale = if distance > 1e-9 {
            self.radius(distance) / distance
        } else {
            1.0
        };
        let tangential = match self.model {
            Model::RadialTangential([_, _, p1, p2, ..]) => {
                let squared = distance * distance;
                DVec2::new(
                    2.0 * p1 * at.x * at.y + p2 * (squared + 2.0 * at.x * at.x),
                    p1 * (squared + 2.0 * at.y * at.y) + 2.0 * p2 * at.x * at.y,
                )
            }
            Model::Equidistant(_) => DVec2::ZERO,
        };
        at * scale + tangential
    }

    /// The ray that meets the sensor at a place, in focal lengths from the axis; `None` when none
    /// within reach does.
    #[must_use]
    pub fn undistort(&self, place: DVec2) -> Option<DVec2> {
        // Few halvings do for most rays, and take a third of the time.
        let mut halvings = [16, 60].into_iter();
        halvings.find_map(|halvings| self.undistort_from(place, halvings))
    }

    /// Returns the ray of [`Lens::undistort`] if Newton's method finds it from where so many halvings of
    /// the range lead.
    fn undistort_from(&self, place: DVec2, halvings: u32) -> Option<DVec2> {
        // The radial part alone rises up to the reach, and is inverted by halving the range.
        let distance = place.length();
        let (mut low, mut high) = (0.0, self.reach);
        for _ in 0..halvings {
            let middle = 0.5 * (low + high);
            if self.radius(middle) < distance {
                low = middle;
            } else {
                high = middle;
            }
        }
        let mut ray = if distance > 0.0 {
            place * (low / distance)
        } else {
            place
        };
        // What is left, and the tangential part, are small: Newton's method takes them away.
        for _ in 0..20 {
            let error = self.distort(ray) - place;
            if error.length() < 1e-12 {
                break;
            }
            let step = 1e-7;
            let column = |offset: DVec2| {
                (self.distort(ray + offset) - self.distort(ray - offset)) / (2.0 * step)
            };
            let jacobian = glam::DMat2::from_cols(
                column(DVec2::new(step, 0.0)),
                column(DVec2::new(0.0, step)),
            );
            ray -= jacobian.inverse() * error;
        }
        let is_exact = (self.distort(ray) - place).length() < 1e-9;
        (is_exact && self.reaches(ray)).then_some(ray)
    }

    /// The distance from the axis, in focal lengths, at which a ray meets the sensor that only the
    /// radial part bends.
    fn radius(&self, tangent: f64) -> f64 {
        match self.model {
            Model::RadialTangential([k1, k2, _, _, k3, k4, k5, k6]) => {
                let squared = tangent * tangent;
                let polynomial =
                    |a: f64, b: f64, c: f64| 1.0 + squared * (a + squared * (b + squared * c));
                let below = polynomial(k4, k5, k6);
                if below <= 0.0 {
                    return f64::NAN;
                }
                tangent * polynomial(k1, k2, k3) / below
            }
            Model::Equidistant([k1, k2, k3, k4]) => {
                let angle = tangent.atan();
                let squared = angle * angle;
                angle * (1.0 + squared * (k1 + squared * (k2 + squared * (k3 + squared * k4))))
            }
        }
    }
}

const NOT_COMPUTED: &str =
    "is not supported: calibrate with plumb_bob, rational_polynomial or equidistant";

/// The refusal of a model, with the name in words beside that in the file where it is known.
pub(super) fn not_computed(name: &str) -> anyhow::Error {
    let words = match name.to_ascii_lowercase().as_str() {
        "ds" => "double sphere (ds)",
        "omni" => "omnidirectional (omni)",
        "eucm" => "extended unified camera (eucm)",
        "ucm" => "unified camera (ucm)",
        "fov" => "field of view (fov)",
        _ => return anyhow!("the lens model {name:?} {NOT_COMPUTED}"),
    };
    anyhow!("the lens model {words} {NOT_COMPUTED}")
}

impl fmt::Display for Lens {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self.model {
            Model::RadialTangential([k1, k2, p1, p2, k3, k4, k5, k6]) => {
                let is_zero = |coefficients: &[f64]| coefficients.iter().all(|&k| k == 0.0);
                if is_zero(&[k1, k2, p1, p2, k3, k4, k5, k6]) {
                    "pinhole without distortion"
                } else if is_zero(&[k4, k5, k6]) {
                    "pinhole, radial-tangential distortion"
                } else {
                    "pinhole, rational distortion"
                }
            }
            Model::Equidistant(_) => "fisheye, equidistant",
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn lenses() -> [Lens; 4] {
        [
            Lens::radial_tangential(&[-0.36, 0.17, 0.001, -0.0008]).unwrap(),
            Lens::radial_tangential(&[0.53, -3.09, 0.0, 0.0, 4.93]).unwrap(),
            Lens::radial_tangential(&[0.4, -0.2, 3e-4, 2e-4, 0.01, 0.75, -0.1, -0.02]).unwrap(),
            Lens::named("equidistant", &[0.0035, 0.0007, -0.002, 0.0002]).unwrap(),
        ]
    }

    #[test]
    fn what_is_distorted_is_undistorted() {
        for lens in lenses() {
            let mut checked = 0;
            for x in -20..=20 {
                for y in -20..=20 {
                    let ray = DVec2::new(f64::from(x), f64::from(y)) * 0.04;
                    if lens.reaches(ray * 1.05) {
                        let back = lens.undistort(lens.distort(ray)).unwrap();
                        assert!((back - ray).length() < 1e-8, "{lens:?} {ray} {back}");
                        checked += 1;
                    }
                }
            }
            assert!(checked > 1000, "{lens:?}: {checked}");
        }
    }

    #[test]
    fn distortion_is_that_of_the_formulas() {
        // By hand: r^2 = 0.05, radial 1 - 0.2 * 0.05 + 0.1 * 0.0025 = 0.99025.
        let lens = Lens::radial_tangential(&[-0.2, 0.1, 0.01, 0.02, 0.0]).unwrap();
        let [x, y] = [0.1, 0.2];
        let expected = DVec2::new(
            x * 0.99025 + 2.0 * 0.01 * x * y + 0.02 * (0.05 + 2.0 * x * x),
            y * 0.99025 + 0.01 * (0.05 + 2.0 * y * y) + 2.0 * 0.02 * x * y,
        );
        assert!((lens.distort(DVec2::new(x, y)) - expected).length() < 1e-12);
        // Without coefficients a fisheye maps 45 degrees to pi / 4.
        let lens = Lens::named("equidistant", &[0.0; 4]).unwrap();
        let at = lens.distort(DVec2::new(1.0, 0.0));
        assert!((at.x - std::f64::consts::FRAC_PI_4).abs() < 1e-12);
    }

    #[test]
    fn a_lens_does_not_reach_beyond_its_fold() {
        // r - 0.3 r^3 rises up to r = sqrt(1 / 0.9).
        let lens = Lens::radial_tangential(&[-0.3, 0.0, 0.0, 0.0]).unwrap();
        let fold = (1.0_f64 / 0.9).sqrt();
        assert!(lens.reaches(DVec2::new(fold - 0.01, 0.0)));
        assert!(!lens.reaches(DVec2::new(fold + 0.01, 0.0)));
        assert_eq!(lens.undistort(DVec2::new(0.0, 0.9)), None);
    }

    #[test]
    fn models_that_are_not_computed_are_refused_by_name() {
        for (name, words) in [
            ("ds", "double sphere"),
            ("omni", "omnidirectional"),
            ("x9", "x9"),
        ] {
            let error = Lens::named(name, &[0.0; 4]).unwrap_err().to_string();
            assert!(error.contains(words), "{error}");
        }
        let prism = [0.1, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.01, 0.0, 0.0, 0.0];
        let error = Lens::radial_tangential(&prism).unwrap_err().to_string();
        assert!(error.contains("thin prism"), "{error}");
        assert!(Lens::radial_tangential(&[0.0; 7]).is_err());
        assert!(Lens::named("equidistant", &[0.0; 5]).is_err());
        let mut zero = [0.0; 14];
        zero[7] = 7.0;
        assert!(Lens::radial_tangential(&zero).is_ok());
    }
}
