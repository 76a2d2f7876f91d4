//! The chi-square distribution: the only one in the crate.
//!
//! With `a = dof / 2` and `y = x / 2` its cumulative distribution is the regularised incomplete gamma function
//! `P(a, y)` and its survival function `Q(a, y) = 1 - P(a, y)`. For `y < a + 1` the power series of `P` converges
//! fast, otherwise the continued fraction of `Q` does (modified Lentz); both are multiplied by
//! `y^a e^-y / Gamma(a)`, kept as a logarithm so that tails far below the least `f64` can still be compared
//! ([`ln_survival`]). Relative accuracy about 1e-12 up to some thousand degrees of freedom.
//!
//! Arguments out of range: `x <= 0` has probability 0, zero degrees of freedom put all probability at 0; NaN
//! gives NaN.

/// Level of a test that calls something impossible: right ones fail it once in ten thousand.
pub const SURE_LEVEL: f64 = 0.9999;

/// `P(X <= x)` for a chi-square variable `X` with `dof` degrees of freedom.
pub fn cdf(x: f64, dof: f64) -> f64 {
    let (ln_p, ln_q) = ln_tails(x, dof);
    if ln_p < ln_q {
        ln_p.exp()
    } else {
        -ln_q.exp_m1()
    }
}

/// `P(X > x)` for a chi-square variable `X` with `dof` degrees of freedom.
pub fn survival(x: f64, dof: f64) -> f64 {
    ln_survival(x, dof).exp()
}

/// `ln P(X > x)`, finite even where [`survival`] underflows.
pub fn ln_survival(x: f64, dof: f64) -> f64 {
    ln_tails(x, dof).1
}

/// The `x` with `P(X <= x) = p`; 0 for `p <= 0` or zero degrees of freedom, infinite for `p >= 1`.
pub fn quantile(p: f64, dof: f64) -> f64 {
    if p.is_nan() || dof.is_nan() {
        return f64::NAN;
    }
    if p <= 0.0 {
        return 0.0;
    }
    if p >= 1.0 {
        return f64::INFINITY;
    }
    // The smaller tail keeps its digits.
    if p <= 0.5 {
        solve(p.ln(), dof, Tail::Lower)
    } else {
        solve((-p).ln_1p(), dof, Tail::Upper)
    }
}

/// The `x` with `ln P(X > x) = ln_q`: the inverse of [`ln_survival`].
pub fn inverse_ln_survival(ln_q: f64, dof: f64) -> f64 {
    if ln_q.is_nan() || dof.is_nan() {
        return f64::NAN;
    }
    if ln_q >= 0.0 {
        return 0.0;
    }
    if ln_q == f64::NEG_INFINITY {
        return f64::INFINITY;
    }
    if ln_q > -std::f64::consts::LN_2 {
        solve((-ln_q.exp_m1()).ln(), dof, Tail::Lower)
    } else {
        solve(ln_q, dof, Tail::Upper)
    }
}

#[derive(Clone, Copy, PartialEq)]
enum Tail {
    Lower,
    Upper,
}

/// Newton's iteration on the logarithm of one tail, kept inside a bracket.
fn solve(ln_tail: f64, dof: f64, tail: Tail) -> f64 {
    if dof <= 0.0 {
        return 0.0;
    }
    let mut x = start(ln_tail, dof, tail);
    let (mut low, mut high) = (0.0, f64::INFINITY);
    for _ in 0..200 {
        let (ln_p, ln_q) = ln_tails(x, dof);
        let value = if tail == Tail::Lower { ln_p } else { ln_q };
        // Positive where x is too large.
        let error = if tail == Tail::Lower {
            value - ln_tail
        } else {
            ln_tail - value
        };
        if error > 0.0 {
            high = x;
        } else {
            low = x;
        }
        // |d ln tail / dx| = density / tail
        let slope = (ln_density(x, dof) - value).exp();
        let newton = x - error / slope;
        let next = if newton > low && newton < high {
            newton
        } else if high.is_finite() {
            0.5 * (low + high)
        } else {
            2.0 * x + 1.0
        };
        if (next - x).abs() <= 4.0 * f64::EPSILON * x || next == x {
            return next;
        }
        x = next;
    }
    x
}

/// Wilson and Hilferty's cube-root approximation, with a rational normal quantile good to 5e-4.
fn start(ln_tail: f64, dof: f64, tail: Tail) -> f64 {
    let t = (-2.0 * ln_tail).sqrt();
    let normal = t
        - (2.515_517 + t * (0.802_853 + t * 0.010_328))
            / (1.0 + t * (1.432_788 + t * (0.189_269 + t * 0.001_308)));
    let z = if tail == Tail::Upper { normal } else { -normal };
    let spread = 2.0 / (9.0 * dof);
    let root = 1.0 - spread + z * spread.sqrt();
    if root > 0.1 {
        dof * root.powi(3)
    } else if tail == Tail::Lower {
        // P ~ y^a / Gamma(a + 1) near zero.
        let a = 0.5 * dof;
        (2.0 * ((ln_tail + ln_gamma(a + 1.0)) / a).exp()).max(f64::MIN_POSITIVE)
    } else {
        dof
    }
}

/// `(ln P(X <= x), ln P(X > x))`.
fn ln_tails(x: f64, dof: f64) -> (f64, f64) {
    if x.is_nan() || dof.is_nan() {
        return (f64::NAN, f64::NAN);
    }
    if x <= 0.0 && dof > 0.0 {
        return (f64::NEG_INFINITY, 0.0);
    }
    if dof <= 0.0 || x == f64::INFINITY {
        // All probability at zero.
        return if x < 0.0 {
            (f64::NEG_INFINITY, 0.0)
        } else {
            (0.0, f64::NEG_INFINITY)
        };
    }
    let (a, y) = (0.5 * dof, 0.5 * x);
    let ln_front = a * y.ln() - y - ln_gamma(a);
    if y < a + 1.0 {
        // P = front / a (1 + y/(a+1) + y^2/((a+1)(a+2)) + ...)
        let (mut term, mut sum, mut n) = (1.0, 1.0, a);
        while term > 1e-17 * sum {
            n += 1.0;
            term *= y / n;
            sum += term;
        }
        let ln_p = (ln_front + sum.ln() - a.ln()).min(0.0);
        (ln_p, ln_one_minus_exp(ln_p))
    } else {
        // Q = front * 1/(y+1-a- 1(1-a)/(y+3-a- 2(2-a)/(y+5-a- ...)))
        let mut b = y + 1.0 - a;
        let mut c = f64::MAX;
        let mut d = 1.0 / b;
        let mut fraction = d;
        for i in 1..100_000 {
            let i = f64::from(i);
            let an = -i * (i - a);
            b += 2.0;
            d = an * d + b;
            if d.abs() < 1e-300 {
                d = 1e-300;
            }
            c = b + an / c;
            if c.abs() < 1e-300 {
                c = 1e-300;
            }
            d = 1.0 / d;
            let factor = d * c;
            fraction *= factor;
            if (factor - 1.0).abs() < 1e-16 {
                break;
            }
        }
        let ln_q = (ln_front + fraction.ln()).min(0.0);
        (ln_one_minus_exp(ln_q), ln_q)
    }
}

/// `ln(1 - e^v)` for `v <= 0`.
fn ln_one_minus_exp(v: f64) -> f64 {
    if v > -std::f64::consts::LN_2 {
        (-v.exp_m1()).ln()
    } else {
        (-v.exp()).ln_1p()
    }
}

/// Logarithm of the density.
fn ln_density(x: f64, dof: f64) -> f64 {
    let (a, y) = (0.5 * dof, 0.5 * x);
    (a - 1.0) * y.ln() - y - ln_gamma(a) - std::f64::consts::LN_2
}

/// `ln Gamma(a)`, `a > 0`: Stirling's series above 12, carried down by `Gamma(a) = Gamma(a + 1) / a`.
fn ln_gamma(a: f64) -> f64 {
    let mut product = 1.0;
    let mut a = a;
    while a < 12.0 {
        product *= a;
        a += 1.0;
    }
    let r = 1.0 / a;
    let r2 = r * r;
    let series = r
        * (1.0 / 12.0
            - r2 * (1.0 / 360.0
                - r2 * (1.0 / 1260.0
                    - r2 * (1.0 / 1680.0 - r2 * (1.0 / 1188.0 - r2 * (691.0 / 360_360.0))))));
    (a - 0.5) * a.ln() - a + 0.918_938_533_204_672_8 + series - product.ln()
}
