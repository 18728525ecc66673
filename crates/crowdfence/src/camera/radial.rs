//! The odd polynomial r (1 + k1 r^2 + k2 r^4 + ...) that both lens models are built on: where it stops
//! growing, and its inverse up to there.

/// Newton needs about five steps; the halvings beside a fold are the slowest and end after an f64's bits.
const MAX_STEPS: usize = 100;

/// r -> r (1 + k1 r^2 + ... + kN r^2N).
#[derive(Debug, Clone, PartialEq)]
pub(super) struct RadialPolynomial<const N: usize> {
    k: [f64; N],
}

impl<const N: usize> RadialPolynomial<N> {
    pub fn new(k: [f64; N]) -> RadialPolynomial<N> {
        RadialPolynomial { k }
    }

    /// 1 + k1 r^2 + ... + kN r^2N: how much farther from the centre the lens images radius r.
    pub fn magnification(&self, r_squared: f64) -> f64 {
        self.k.iter().rev().fold(0.0, |sum, k| sum * r_squared + k) * r_squared + 1.0
    }

    /// d magnification / d r^2 = k1 + 2 k2 r^2 + ... + N kN r^(2N - 2).
    pub fn magnification_slope(&self, r_squared: f64) -> f64 {
        let terms = self.k.iter().enumerate().rev();
        terms.fold(0.0, |sum, (index, k)| sum * r_squared + (index + 1) as f64 * k)
    }

    pub fn value(&self, r: f64) -> f64 {
        r * self.magnification(r * r)
    }

    /// d value / d r.
    pub fn slope(&self, r: f64) -> f64 {
        let r_squared = r * r;
        self.magnification(r_squared) + 2.0 * r_squared * self.magnification_slope(r_squared)
    }

    /// Coefficients of the magnification in ascending powers of r: 1, 0, k1, 0, k2, ...
    pub fn magnification_coefficients(&self) -> Vec<f64> {
        let even = std::iter::once(1.0).chain(self.k);
        even.flat_map(|k| [k, 0.0]).take(2 * N + 1).collect()
    }

    /// Coefficients of the slope in ascending powers of r: 1, 0, 3 k1, 0, 5 k2, ...
    pub fn slope_coefficients(&self) -> Vec<f64> {
        let powers = (1..).map(f64::from);
        self.magnification_coefficients().iter().zip(powers).map(|(k, power)| k * power).collect()
    }

    /// The r in [0, end) with value(r) = target >= 0, where the polynomial grows all the way to `end`.
    ///
    /// None if the polynomial does not reach the target before `end`. Newton's method kept inside a bracket,
    /// so that it cannot leave the branch that starts at 0.
    pub fn invert(&self, target: f64, end: f64) -> Option<f64> {
        let reached = target < self.value(end);
        reached.then(|| {
            let (mut low, mut high) = (0.0, end);
            let mut r = target.min(0.5 * end);
            for _ in 0..MAX_STEPS {
                let excess = self.value(r) - target;
                if excess > 0.0 {
                    high = r;
                } else {
                    low = r;
                }
                let newton = r - excess / self.slope(r);
                if (newton - r).abs() <= f64::EPSILON * r {
                    break;
                }
                let inside = low < newton && newton < high;
                r = if inside { newton } else { 0.5 * (low + high) };
            }
            r
        })
    }
}

/// Smallest root in (0, limit) of the polynomial with these coefficients (ascending powers, positive at 0),
/// or `limit` if there is none. Rounded towards 0, where the polynomial is still positive.
pub(super) fn first_root(coefficients: &[f64], limit: f64) -> f64 {
    roots(coefficients, limit).first().copied().unwrap_or(limit)
}

/// Roots in (0, limit) in ascending order. Between neighbouring roots of its derivative a polynomial is
/// monotone, so that each sign change there brackets one root and no root is missed.
fn roots(coefficients: &[f64], limit: f64) -> Vec<f64> {
    if coefficients.len() < 2 {
        return Vec::new();
    }
    let powers = (1..).map(f64::from);
    let derivative: Vec<f64> = coefficients[1..].iter().zip(powers).map(|(c, power)| c * power).collect();
    let turns = roots(&derivative, limit);
    let knots: Vec<f64> = [0.0].into_iter().chain(turns).chain([limit]).collect();
    let brackets = knots.windows(2).map(|ends| (ends[0], ends[1]));
    brackets.filter_map(|(low, high)| bisect(coefficients, low, high)).collect()
}

/// The last number before the sign change in [low, high], if there is one.
fn bisect(coefficients: &[f64], mut low: f64, mut high: f64) -> Option<f64> {
    let sign = |r: f64| coefficients.iter().rev().fold(0.0, |sum, c| sum * r + c);
    let start = sign(low);
    if start * sign(high).signum() >= 0.0 {
        return None;
    }
    loop {
        let middle = 0.5 * (low + high);
        if middle <= low || middle >= high {
            return Some(low);
        }
        if start * sign(middle).signum() > 0.0 {
            low = middle;
        } else {
            high = middle;
        }
    }
}
