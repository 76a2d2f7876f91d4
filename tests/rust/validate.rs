//! Batch validation: HOHCT against brute force, and on batches as a camera makes them; JCBB, 1-point, gate; chi-square.

use ekf_core::chi2;
use ekf_core::settings::ValidateSettings;
use ekf_core::validate::{
    Batch, BatchTest, Blocks, HohctSettings, JcbbSettings, OnePointSettings, Verdict, Workspace,
    conditional_gate,
};
use nalgebra::{DMatrix, DVector, Matrix3};
use rand::seq::index;
use rand::{Rng, SeedableRng};
use rand_pcg::Pcg64;

/// A batch with the truth about it.
struct Case {
    offsets: Vec<usize>,
    s: DMatrix<f64>,
    l: DMatrix<f64>,
    g: DVector<f64>,
    noise: Vec<Matrix3<f64>>,
    wrong: Vec<usize>,
}

impl Case {
    fn new(offsets: Vec<usize>, s: DMatrix<f64>, g: DVector<f64>) -> Self {
        let l = s.clone().cholesky().unwrap().unpack();
        let noise = vec![Matrix3::identity(); offsets.len() - 1];
        Self {
            offsets,
            s,
            l,
            g,
            noise,
            wrong: Vec::new(),
        }
    }

    fn run(&self, test: BatchTest, ws: &mut Workspace) -> (Verdict, Vec<usize>) {
        let batch = Batch {
            s: self.s.as_slice(),
            l: self.l.as_slice(),
            ld: self.g.len(),
            g: self.g.as_slice(),
            noise: &self.noise,
            blocks: Blocks::new(&self.offsets),
        };
        let verdict = test.run(&batch, ws);
        (verdict, ws.rejected().to_vec())
    }

    /// Joint distance and degrees of freedom of the blocks outside of `out`, from the definition.
    fn rest(&self, out: &[usize]) -> (f64, usize) {
        let rows: Vec<usize> = (0..self.offsets.len() - 1)
            .filter(|block| !out.contains(block))
            .flat_map(|block| self.offsets[block]..self.offsets[block + 1])
            .collect();
        let s = self.s.select_rows(&rows).select_columns(&rows);
        let g = self.g.select_rows(&rows);
        match s.cholesky() {
            Some(factor) if !rows.is_empty() => (g.dot(&factor.solve(&g)), rows.len()),
            _ => (0.0, 0),
        }
    }

    /// HOHCT from its definition: every set of every order.
    fn brute_force(&self, level: f64, max_order: usize) -> Option<Vec<usize>> {
        let n = self.offsets.len() - 1;
        for order in 0..=max_order {
            let mut best: Option<(f64, Vec<usize>)> = None;
            for mask in (0_u32..1 << n).filter(|mask| mask.count_ones() as usize == order) {
                let out: Vec<usize> = (0..n).filter(|block| mask >> block & 1 == 1).collect();
                let (d2, dof) = self.rest(&out);
                let tail = chi2::ln_survival(d2, dof as f64);
                let passes = d2 <= chi2::quantile(level, dof as f64);
                if passes && best.as_ref().is_none_or(|(t, _)| tail > *t) {
                    best = Some((tail, out));
                }
            }
            if let Some((_, out)) = best {
                return Some(out);
            }
        }
        None
    }
}

fn normal(rng: &mut Pcg64) -> f64 {
    let (u, v): (f64, f64) = (rng.random_range(1e-300..1.0), rng.random());
    (-2.0 * u.ln()).sqrt() * (std::f64::consts::TAU * v).cos()
}

fn offsets_of(counts: impl Iterator<Item = usize>) -> Vec<usize> {
    std::iter::once(0)
        .chain(counts.scan(0, |sum, count| {
            *sum += count;
            Some(*sum)
        }))
        .collect()
}

/// A small batch with strong correlations and some matches disturbed.
fn small_case(rng: &mut Pcg64, counts: &[usize], wrong: usize) -> Case {
    let offsets = offsets_of(counts.iter().copied());
    let m = *offsets.last().unwrap();
    let spread = 10.0_f64.powf(rng.random_range(-0.5..1.0));
    let rank = rng.random_range(1..=6);
    let h = DMatrix::from_fn(m, rank, |_, _| spread * normal(rng));
    let own = DMatrix::from_fn(m, m, |_, _| 0.3 * normal(rng));
    let s = &h * h.transpose() + &own * own.transpose() + DMatrix::identity(m, m);
    let l = s.clone().cholesky().unwrap().unpack();
    let mut g = l * DVector::from_fn(m, |_, _| normal(rng));
    let size = 10.0_f64.powf(rng.random_range(0.0..1.5));
    for block in index::sample(rng, counts.len(), wrong) {
        for row in offsets[block]..offsets[block + 1] {
            g[row] += size * normal(rng);
        }
    }
    Case::new(offsets, s, g)
}

/// A frame's batch: a camera of uncertain pose (3 cm, 1 degree) sees mapped points at 1 to 10 m through 500 px of focal
/// length with 1 px of noise; every third match has a depth row (metres, its range to 5 %) if asked for; the points share
/// some of the map's drift. `wrong` matches are uniform in the 3-sigma ellipse (ellipsoid) of their prediction.
fn frame_case(rng: &mut Pcg64, n: usize, wrong: usize, depth: bool) -> Case {
    let with_depth = |block: usize| depth && block.is_multiple_of(3);
    let offsets = offsets_of((0..n).map(|block| if with_depth(block) { 3 } else { 2 }));
    let m = *offsets.last().unwrap();
    let (focal, sigma_t, sigma_r) = (500.0, 0.03, 1.0_f64.to_radians());
    let mut h = DMatrix::zeros(m, 12);
    let mut s = DMatrix::zeros(m, m);
    let mut noise = Vec::new();
    for block in 0..n {
        let z = rng.random_range(1.0..10.0_f64);
        let (x, y) = (
            z * rng.random_range(-0.7..0.7),
            z * rng.random_range(-0.5..0.5),
        );
        // d p_c / d pose, then the measured rows; the map's drift acts as a second, smaller pose.
        let by_pose = DMatrix::from_row_slice(
            3,
            6,
            &[
                1.0, 0.0, 0.0, 0.0, z, -y, 0.0, 1.0, 0.0, -z, 0.0, x, 0.0, 0.0, 1.0, y, -x, 0.0,
            ],
        );
        let rows = if with_depth(block) { 3 } else { 2 };
        let (jac, r) = if rows == 3 {
            let mut r = DMatrix::identity(3, 3) * (z / focal).powi(2);
            let ray = DVector::from_vec(vec![x, y, z]);
            r += 0.05_f64.powi(2) * &ray * ray.transpose();
            (DMatrix::identity(3, 3), r)
        } else {
            let k = focal / z;
            let jac = DMatrix::from_row_slice(2, 3, &[k, 0.0, -k * x / z, 0.0, k, -k * y / z]);
            (jac, DMatrix::identity(2, 2))
        };
        let rows_h = &jac * by_pose;
        let at = offsets[block];
        for c in 0..6 {
            let sigma = if c < 3 { sigma_t } else { sigma_r };
            for row in 0..rows {
                h[(at + row, c)] = rows_h[(row, c)] * sigma;
                h[(at + row, 6 + c)] = rows_h[(row, c)] * sigma * 0.2 * normal(rng);
            }
        }
        let own = 0.004 * z;
        let map = &jac * jac.transpose() * own * own;
        s.view_mut((at, at), (rows, rows)).copy_from(&(map + &r));
        let mut block = Matrix3::identity();
        block.view_mut((0, 0), (rows, rows)).copy_from(&r);
        noise.push(block);
    }
    s += &h * h.transpose();
    let l = s.clone().cholesky().unwrap().unpack();
    let mut g = l * DVector::from_fn(m, |_, _| normal(rng));
    let mut chosen = index::sample(rng, n, wrong).into_vec();
    chosen.sort_unstable();
    for &block in &chosen {
        let (at, rows) = (offsets[block], offsets[block + 1] - offsets[block]);
        let block = s.view((at, at), (rows, rows)).into_owned();
        let l = block.cholesky().unwrap().unpack();
        let inside = loop {
            let v = DVector::from_fn(rows, |_, _| rng.random_range(-1.0..1.0));
            if v.norm() <= 1.0 {
                break v;
            }
        };
        g.rows_mut(at, rows).copy_from(&(l * inside * 3.0));
    }
    let mut case = Case::new(offsets, s, g);
    case.noise = noise;
    case.wrong = chosen;
    case
}

/// A budget that only a search gone astray reaches.
fn thorough() -> HohctSettings {
    HohctSettings {
        max_nodes: 20_000,
        ..HohctSettings::default()
    }
}

#[test]
fn hohct_equals_brute_force() {
    let mut rng = Pcg64::seed_from_u64(11);
    let mut ws = Workspace::default();
    let mut orders = [0; 6];
    for trial in 0..1500 {
        let n = rng.random_range(2..=9);
        let counts: Vec<usize> = match trial % 3 {
            0 => vec![2; n],
            1 => (0..n).map(|_| rng.random_range(2..=3)).collect(),
            _ => (0..n).map(|_| rng.random_range(1..=3)).collect(),
        };
        let wrong = rng.random_range(0..=n.min(5) - 1);
        let case = small_case(&mut rng, &counts, wrong);
        let share = 4.0 / n as f64;
        let settings = HohctSettings {
            level: if trial % 2 == 0 { 0.95 } else { 0.6 },
            max_share: share.min(1.0),
            ..thorough()
        };
        let max_order = ((settings.max_share * n as f64) as usize).min(n - 1);
        let (verdict, rejected) = case.run(BatchTest::Hohct(settings), &mut ws);
        assert!(verdict.exact, "trial {trial}");
        match case.brute_force(settings.level, max_order) {
            Some(expected) => {
                assert!(verdict.passed, "trial {trial}");
                assert_eq!(rejected, expected, "trial {trial}");
                let (d2, dof) = case.rest(&expected);
                assert!((verdict.d2 - d2).abs() < 1e-6 * (1.0 + d2));
                assert_eq!((verdict.dof, verdict.order), (dof, expected.len()));
                let tail = chi2::survival(d2, dof as f64);
                assert!((verdict.p_value - tail).abs() < 1e-6);
                orders[verdict.order] += 1;
            }
            None => {
                assert!(!verdict.passed);
                assert_eq!(rejected, (0..n).collect::<Vec<_>>());
                orders[5] += 1;
            }
        }
    }
    assert!(orders.iter().all(|&count| count > 15), "{orders:?}");
}

#[test]
fn hohct_equals_brute_force_on_frames() {
    let mut rng = Pcg64::seed_from_u64(18);
    let mut ws = Workspace::default();
    for trial in 0..100 {
        let n = rng.random_range(9..=12);
        let wrong = rng.random_range(1..=4);
        let case = frame_case(&mut rng, n, wrong, trial % 2 == 0);
        let settings = HohctSettings {
            level: 0.9,
            max_share: 4.5 / n as f64,
            ..thorough()
        };
        let (verdict, rejected) = case.run(BatchTest::Hohct(settings), &mut ws);
        assert!(verdict.exact);
        match case.brute_force(settings.level, 4) {
            Some(expected) => assert_eq!(rejected, expected, "trial {trial}"),
            None => assert!(!verdict.passed, "trial {trial}"),
        }
    }
}

#[test]
fn hohct_is_exact_on_frames_with_wrong_matches() {
    let mut rng = Pcg64::seed_from_u64(12);
    let mut ws = Workspace::default();
    for (n, wrong, depth) in [
        (40, 0, false),
        (40, 1, false),
        (40, 3, false),
        (40, 10, false),
        (100, 3, false),
        (100, 10, false),
        (40, 3, true),
        (100, 10, true),
    ] {
        let (mut nodes, mut most, mut kept, mut lost) = (0, 0, 0, 0);
        let trials = 12;
        for _ in 0..trials {
            let case = frame_case(&mut rng, n, wrong, depth);
            let (verdict, rejected) = case.run(BatchTest::Hohct(thorough()), &mut ws);
            assert!(verdict.exact && verdict.passed, "{n} {wrong} {verdict:?}");
            nodes += verdict.nodes;
            most = most.max(verdict.nodes);
            kept += case.wrong.iter().filter(|u| !rejected.contains(u)).count();
            lost += rejected.iter().filter(|u| !case.wrong.contains(u)).count();
        }
        println!(
            "{wrong} wrong of {n}, depth {depth}: {} nodes on average, {most} at most; \
             per batch {:.2} wrong kept, {:.2} right lost",
            nodes / trials,
            kept as f64 / trials as f64,
            lost as f64 / trials as f64
        );
        assert!(lost < trials, "right matches lost: {lost} in {trials}");
        assert!(kept <= trials * wrong / 2, "wrong matches kept: {kept}");
    }
}

#[test]
fn hohct_is_quiet_when_all_is_right() {
    let mut rng = Pcg64::seed_from_u64(13);
    let mut ws = Workspace::default();
    let trials = 400;
    let mut passed_at_once = 0;
    for _ in 0..trials {
        let case = frame_case(&mut rng, 30, 0, true);
        let (verdict, _) = case.run(BatchTest::Hohct(thorough()), &mut ws);
        passed_at_once += usize::from(verdict.order == 0);
    }
    // 95 % expected, standard deviation 1.1 %.
    assert!((370..=392).contains(&passed_at_once), "{passed_at_once}");
}

/// One match slips by some standard deviations of what the others leave open of it.
#[test]
fn hohct_finds_slips_at_the_true_sigma() {
    // How often 60 numbers exceed their quantile at 95 % then, by the non-central chi-square distribution: no joint test
    // can do better. And the share of all slips that must be found, four standard deviations below what 30 independent
    // matches would give.
    let expected = [
        (3.0, 0.203, 0.09),
        (4.0, 0.389, 0.27),
        (5.0, 0.638, 0.53),
        (6.0, 0.853, 0.78),
        (7.0, 0.964, 0.92),
        (8.0, 0.995, 0.98),
    ];
    let mut rng = Pcg64::seed_from_u64(27);
    let mut ws = Workspace::default();
    let trials = 400;
    for (slip, power, least) in expected {
        let (mut noticed, mut found) = (0, 0);
        for _ in 0..trials {
            let mut case = frame_case(&mut rng, 30, 0, false);
            let inverse = case.s.clone().cholesky().unwrap().inverse();
            let block = rng.random_range(0..30);
            let (sin, cos) = rng.random_range(0.0..std::f64::consts::TAU).sin_cos();
            let way = DVector::from_vec(vec![cos, sin]);
            let at = case.offsets[block];
            let left = inverse.view((at, at), (2, 2)) * &way;
            let mut slipped = case.g.rows_mut(at, 2);
            slipped += &way * (slip / way.dot(&left).sqrt());
            let (verdict, rejected) = case.run(BatchTest::Hohct(HohctSettings::default()), &mut ws);
            noticed += usize::from(verdict.order > 0);
            found += usize::from(rejected.contains(&block));
        }
        let share = |count: usize| count as f64 / trials as f64;
        let spread = (power * (1.0 - power) / trials as f64).sqrt();
        println!(
            "{slip} sigma: {:.3} noticed, {:.3} found",
            share(noticed),
            share(found)
        );
        assert!(
            (share(noticed) - power).abs() < 4.0 * spread,
            "{slip} sigma: {} noticed, {power} expected",
            share(noticed)
        );
        assert!(share(found) >= least, "{slip} sigma: {}", share(found));
    }
}

#[test]
fn budget_falls_back_to_greedy_and_says_so() {
    let mut rng = Pcg64::seed_from_u64(14);
    let mut ws = Workspace::default();
    let tight = HohctSettings {
        max_nodes: 1,
        ..thorough()
    };
    let (mut struck, mut trials) = (0, 0);
    while trials < 100 {
        let case = frame_case(&mut rng, 40, 6, false);
        let (verdict, rejected) = case.run(BatchTest::Hohct(tight), &mut ws);
        if verdict.order == 0 {
            continue;
        }
        trials += 1;
        assert!(verdict.passed);
        let (d2, dof) = case.rest(&rejected);
        assert!((verdict.d2 - d2).abs() < 1e-6 * d2);
        assert!(d2 <= chi2::quantile(0.95, dof as f64) + 1e-6);
        let (full, _) = case.run(BatchTest::Hohct(thorough()), &mut ws);
        assert!(full.exact && full.order <= verdict.order);
        struck += usize::from(!verdict.exact);
    }
    assert!(struck > 0);
}

#[test]
fn a_large_budget_holds_hard_searches() {
    // At a low level right matches have to go as well, and many sets are about as good.
    let mut rng = Pcg64::seed_from_u64(21);
    let mut ws = Workspace::default();
    let all = HohctSettings {
        level: 0.55,
        ..thorough()
    };
    assert!(all.max_nodes > ValidateSettings::default().max_nodes);
    let mut hard = 0;
    for _ in 0..40 {
        let case = frame_case(&mut rng, 24, 4, false);
        let (verdict, rejected) = case.run(BatchTest::Hohct(all), &mut ws);
        assert!(verdict.exact && verdict.nodes < all.max_nodes);
        if verdict.nodes <= 50 {
            continue;
        }
        hard += 1;
        let fewer = HohctSettings {
            max_nodes: verdict.nodes / 2,
            ..all
        };
        let (struck, other) = case.run(BatchTest::Hohct(fewer), &mut ws);
        assert!(!struck.exact && struck.order >= verdict.order);
        assert!(struck.order > verdict.order || struck.d2 >= verdict.d2 || other == rejected);
    }
    assert!(hard > 0);
}

#[test]
fn hohct_edges() {
    let mut ws = Workspace::default();
    let test = BatchTest::Hohct(thorough());
    let empty = Case::new(vec![0], DMatrix::identity(0, 0), DVector::zeros(0));
    let (verdict, rejected) = empty.run(test, &mut ws);
    assert!(verdict.passed && rejected.is_empty() && verdict.p_value == 1.0);
    let lone = Case::new(
        vec![0, 2],
        DMatrix::identity(2, 2),
        DVector::from_vec(vec![9.0, 9.0]),
    );
    let (verdict, rejected) = lone.run(test, &mut ws);
    assert!(!verdict.passed && rejected == [0]);
    let broken = Case::new(
        vec![0, 2, 4],
        DMatrix::identity(4, 4),
        DVector::from_vec(vec![f64::NAN, 0.0, 0.0, 0.0]),
    );
    assert!(!broken.run(test, &mut ws).0.passed);
    // More wrong than may be left out.
    let lost = Case::new(
        (0..5).map(|i| 2 * i).collect(),
        DMatrix::identity(8, 8),
        DVector::from_element(8, 50.0),
    );
    let (verdict, rejected) = lost.run(test, &mut ws);
    assert!(!verdict.passed && rejected == [0, 1, 2, 3] && verdict.exact);
}

#[test]
fn results_repeat_and_do_not_depend_on_the_workspace() {
    let mut rng = Pcg64::seed_from_u64(15);
    let mut used = Workspace::default();
    for trial in 0..24 {
        let case = frame_case(&mut rng, 10 + 2 * trial, trial / 6, trial % 2 == 0);
        for test in [
            BatchTest::Hohct(thorough()),
            BatchTest::Jcbb(JcbbSettings {
                max_nodes: 200,
                ..JcbbSettings::default()
            }),
            BatchTest::OnePoint(OnePointSettings::default()),
            BatchTest::Individual(0.99),
            BatchTest::None,
        ] {
            assert_eq!(
                case.run(test, &mut used),
                case.run(test, &mut Workspace::default())
            );
        }
    }
}

#[test]
fn jcbb_finds_a_largest_compatible_set() {
    let mut rng = Pcg64::seed_from_u64(16);
    let mut ws = Workspace::default();
    for trial in 0..400 {
        let n = rng.random_range(2..=8);
        let counts: Vec<usize> = (0..n).map(|_| rng.random_range(2..=3)).collect();
        let wrong = rng.random_range(0..n);
        let case = small_case(&mut rng, &counts, wrong);
        let settings = JcbbSettings::default();
        let (verdict, rejected) = case.run(BatchTest::Jcbb(settings), &mut ws);
        assert!(verdict.exact);
        let compatible = |kept: &[usize]| {
            let out: Vec<usize> = (0..n).filter(|block| !kept.contains(block)).collect();
            let (d2, dof) = case.rest(&out);
            d2 <= chi2::quantile(settings.level, dof as f64)
        };
        let fits: Vec<usize> = (0..n).filter(|&block| compatible(&[block])).collect();
        let kept: Vec<usize> = (0..n).filter(|block| !rejected.contains(block)).collect();
        assert!(kept.is_empty() || compatible(&kept), "trial {trial}");
        // Branches are cut at the first match that does not fit, so the largest set is one that can be grown
        // match by match in the order of the tree.
        let (d2, dof) = case.rest(&rejected);
        assert_eq!((verdict.dof, verdict.order), (dof, rejected.len()));
        assert!((verdict.d2 - d2).abs() < 1e-6 * (1.0 + d2));
        assert!(kept.iter().all(|block| fits.contains(block)));
        for &block in fits.iter().filter(|block| !kept.contains(block)) {
            let mut more = kept.clone();
            more.push(block);
            more.sort_unstable();
            let chain_breaks = {
                let mut order = more.clone();
                let own = |block: usize| {
                    let out: Vec<usize> = (0..n).filter(|other| *other != block).collect();
                    case.rest(&out).0
                };
                order.sort_by(|a, b| own(*a).total_cmp(&own(*b)));
                (1..=order.len()).any(|k| !compatible(&order[..k]))
            };
            assert!(chain_breaks, "trial {trial}: {block} fits as well");
        }
    }
}

#[test]
fn the_others_find_gross_errors_too() {
    let mut rng = Pcg64::seed_from_u64(17);
    let mut ws = Workspace::default();
    for test in [
        BatchTest::Jcbb(JcbbSettings {
            max_nodes: 20_000,
            ..JcbbSettings::default()
        }),
        BatchTest::OnePoint(OnePointSettings::default()),
    ] {
        let (mut kept, mut lost) = (0, 0);
        for _ in 0..20 {
            let case = frame_case(&mut rng, 30, 2, true);
            let (verdict, rejected) = case.run(test, &mut ws);
            assert_eq!(verdict.order, rejected.len());
            let (d2, dof) = case.rest(&rejected);
            assert!((verdict.d2 - d2).abs() < 1e-6 * d2 && verdict.dof == dof);
            kept += case.wrong.iter().filter(|u| !rejected.contains(u)).count();
            lost += rejected.iter().filter(|u| !case.wrong.contains(u)).count();
        }
        assert!(
            kept <= 20 && lost <= 50,
            "{test:?}: kept {kept}, lost {lost}"
        );
    }
}

/// The conditional gate from its definition: the worst block given the rest goes, again and again.
fn conditional_by_definition(case: &Case, level: f64) -> Vec<usize> {
    let counts: Vec<usize> = case.offsets.windows(2).map(|w| w[1] - w[0]).collect();
    let mut out = Vec::new();
    loop {
        let (all, _) = case.rest(&out);
        let conditional_d2 = |block: usize| {
            let without: Vec<usize> = out.iter().copied().chain([block]).collect();
            (all - case.rest(&without).0) / chi2::quantile(level, counts[block] as f64)
        };
        let worst = (0..counts.len())
            .filter(|block| !out.contains(block))
            .map(|block| (conditional_d2(block), block))
            .max_by(|a, b| a.0.total_cmp(&b.0));
        match worst {
            Some((ratio, block)) if ratio > 1.0 => out.push(block),
            _ => break,
        }
    }
    out.sort_unstable();
    out
}

#[test]
fn conditional_gate_is_its_definition() {
    let mut rng = Pcg64::seed_from_u64(23);
    let mut ws = Workspace::default();
    let mut rejected_in_all = 0;
    for trial in 0..60 {
        let case = frame_case(&mut rng, 20, trial % 4, trial % 2 == 0);
        let blocks = Blocks::new(&case.offsets);
        let (l, g) = (case.l.as_slice(), case.g.as_slice());
        let verdict = conditional_gate(l, g.len(), g, blocks, 0.99, 1.0, &mut ws);
        let (d2, dof) = case.rest(ws.rejected());
        assert_eq!(ws.rejected(), conditional_by_definition(&case, 0.99));
        assert!((verdict.d2 - d2).abs() < 1e-6 * (1.0 + d2) && verdict.dof == dof);
        assert!(verdict.passed && verdict.order == ws.rejected().len());
        rejected_in_all += verdict.order;
    }
    assert!(rejected_in_all > 60, "{rejected_in_all}");
}

#[test]
fn conditional_gate_sees_what_drowns_in_the_joint_test() {
    // 40 matches that err by a fifth of what they state, and one by six of the sigmas that the others leave it.
    let mut rng = Pcg64::seed_from_u64(29);
    let mut ws = Workspace::default();
    for _ in 0..20 {
        let mut case = frame_case(&mut rng, 40, 0, false);
        case.g *= 0.2;
        let inverse = case.s.clone().cholesky().unwrap().inverse();
        case.g[14] += 6.0 / inverse[(14, 14)].sqrt();
        let hohct = BatchTest::Hohct(thorough());
        assert!(case.run(hohct, &mut ws).1.is_empty());
        let blocks = Blocks::new(&case.offsets);
        let (l, g) = (case.l.as_slice(), case.g.as_slice());
        conditional_gate(l, g.len(), g, blocks, 0.9999, 0.5, &mut ws);
        assert_eq!(ws.rejected(), [7]);
    }
}

#[test]
fn conditional_gate_has_edges() {
    let mut ws = Workspace::default();
    let none = conditional_gate(&[], 0, &[], Blocks::new(&[0]), 0.99, 0.5, &mut ws);
    assert!(none.passed && none.dof == 0);
    // More offenders than may go: it says so.
    let s = DMatrix::identity(4, 4);
    let case = Case::new(vec![0, 2, 4], s, DVector::from_vec(vec![9.0; 4]));
    let blocks = Blocks::new(&case.offsets);
    let (l, g) = (case.l.as_slice(), case.g.as_slice());
    let verdict = conditional_gate(l, 4, g, blocks, 0.99, 0.5, &mut ws);
    assert!(!verdict.passed && ws.rejected().len() == 1);
}

#[test]
fn individual_gate_and_no_gate() {
    let mut ws = Workspace::default();
    let case = Case::new(
        vec![0, 2, 5],
        DMatrix::identity(5, 5) * 4.0,
        DVector::from_vec(vec![4.9, 0.0, 5.0, 2.0, 0.0]),
    );
    // 4.9^2 / 4 = 6.0025 > 5.991 and 29 / 4 = 7.25 < 7.815.
    let (verdict, rejected) = case.run(BatchTest::Individual(0.95), &mut ws);
    assert_eq!(rejected, [0]);
    assert!((verdict.d2 - 7.25).abs() < 1e-12 && verdict.dof == 3 && verdict.passed);
    let (verdict, rejected) = case.run(BatchTest::None, &mut ws);
    assert!(rejected.is_empty() && (verdict.d2 - 13.2525).abs() < 1e-12);
}

/// scipy.stats.chi2.cdf, .sf and .ppf of the same arguments.
#[test]
fn chi_square_values() {
    for (x, dof, cdf, sf) in [
        (0.1, 1.0, 0.24817036595415076, 0.7518296340458492),
        (3.8414588, 1.0, 0.9499999993829125, 0.05000000061708755),
        (5.991, 2.0, 0.9499883849734209, 0.05001161502657909),
        (7.8, 3.0, 0.9496689021401467, 0.050331097859853326),
        (70.0, 80.0, 0.219809554825318, 0.7801904451746821),
        (101.8, 80.0, 0.9494453784985669, 0.050554621501433084),
        (300.0, 80.0, 1.0, 3.493248865950228e-27),
        (0.001, 2.0, 0.0004998750208307296, 0.9995001249791693),
        (250.0, 200.0, 0.9906208683311739, 0.009379131668826098),
        (0.5, 30.0, 5.634558720450966e-22, 1.0),
        (150.0, 200.0, 0.0033524414981869932, 0.996647558501813),
        (2000.0, 1200.0, 1.0, 5.979195674964684e-43),
    ] {
        assert!((chi2::cdf(x, dof) / cdf - 1.0).abs() < 1e-10, "{x} {dof}");
        assert!(
            (chi2::survival(x, dof) / sf - 1.0).abs() < 1e-10,
            "{x} {dof}"
        );
    }
    for (p, dof, x) in [
        (0.95, 1.0, 3.841458820694124),
        (0.95, 2.0, 5.991464547107979),
        (0.95, 3.0, 7.814727903251179),
        (0.95, 80.0, 101.87947396543588),
        (0.99, 200.0, 249.4451229814416),
        (0.5, 1.0, 0.454936423119572),
        (0.001, 5.0, 0.2102126026292192),
        (0.95, 1200.0, 1281.701949148215),
        (0.999, 2.0, 13.815510557964274),
    ] {
        assert!(
            (chi2::quantile(p, dof) / x - 1.0).abs() < 1e-10,
            "{p} {dof}"
        );
    }
}

/// Even degrees of freedom in 60 digits: `-x/2 + ln sum_{j < dof/2} (x/2)^j / j!`; odd by the erfc series.
#[test]
fn chi_square_far_tails() {
    for (x, dof, ln_sf) in [
        (500.0, 2.0, -250.0),
        (500.0, 80.0, -141.1260476360825),
        (5000.0, 80.0, -2301.478249310793),
        (900.0, 60.0, -344.02240709939656),
        (100_000.0, 200.0, -49287.97417328992),
        (1200.0, 1200.0, -0.7040644918848876),
        (10_000.0, 3.0, -4995.620521181652),
    ] {
        assert!(
            (chi2::ln_survival(x, dof) / ln_sf - 1.0).abs() < 1e-11,
            "{x} {dof}"
        );
        let back = chi2::inverse_ln_survival(ln_sf, dof);
        assert!((back / x - 1.0).abs() < 1e-10, "{back} {x}");
    }
}

#[test]
fn chi_square_round_trip_and_limits() {
    for dof in [1.0, 2.0, 3.0, 7.0, 40.0, 80.0, 300.0, 2000.0] {
        for p in [
            1e-12,
            1e-3,
            0.05,
            0.4999,
            0.5001,
            0.9,
            0.95,
            0.999,
            1.0 - 1e-12,
        ] {
            let x = chi2::quantile(p, dof);
            assert!((chi2::cdf(x, dof) / p - 1.0).abs() < 1e-10, "{p} {dof}");
        }
    }
    assert_eq!(chi2::quantile(0.0, 3.0), 0.0);
    assert_eq!(chi2::quantile(1.0, 3.0), f64::INFINITY);
    assert_eq!(chi2::quantile(0.95, 0.0), 0.0);
    assert_eq!(chi2::cdf(-1.0, 3.0), 0.0);
    assert_eq!(chi2::survival(-1.0, 3.0), 1.0);
    assert_eq!(chi2::cdf(f64::INFINITY, 3.0), 1.0);
    assert!(chi2::cdf(f64::NAN, 3.0).is_nan() && chi2::quantile(f64::NAN, 3.0).is_nan());
}
