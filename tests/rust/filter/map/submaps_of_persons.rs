//! What submaps transfer of several persons' errors: consistent where one tracker makes them err together, and no person left out.

use crate::graph::{BAND, EDGE_SD, STAYS, draw, nees};
use crate::scene::{DT, Scene, adopt, name, rng, settings};
use ekf_core::graph::{Edge, Factor, Node, PoseGraph, Transferred};
use ekf_core::math::pose::Pose;
use ekf_core::settings::Value;
use ekf_core::state::transferred_dim;
use ekf_core::{Filter, WornObservation};
use nalgebra::{DMatrix, DVector, Matrix6, SMatrix, Vector6};
use rand_pcg::Pcg64;
use std::collections::BTreeMap;

/// Of the variance of the time-correlated errors, what all persons have in common.
const SHARE: f64 = 0.3;
/// Standard deviation of a time-correlated error, metres and radians.
const TIME_CORRELATED_SD: [f64; 2] = [0.02, 0.01];

fn time_correlated_sd() -> Vector6<f64> {
    Vector6::from_fn(|i, _| TIME_CORRELATED_SD[i / 3])
}

/// Time-correlated errors of two persons along the axes of C.
fn time_correlated_errors(rng: &mut Pcg64) -> [Vector6<f64>; 2] {
    let common: Vector6<f64> = draw(rng);
    [(); 2].map(|()| {
        let own: Vector6<f64> = draw(rng);
        time_correlated_sd().component_mul(&(own * (1.0 - SHARE).sqrt() + common * SHARE.sqrt()))
    })
}

/// As stated: of both persons, along the axes of C.
fn stated() -> SMatrix<f64, 12, 12> {
    let variance = time_correlated_sd().map(|s| s * s);
    SMatrix::from_fn(|i, j| match (i % 6 == j % 6, i == j) {
        (true, true) => variance[i % 6],
        (true, false) => SHARE * variance[i % 6],
        _ => 0.0,
    })
}

/// A filter among points, and two persons beside it whose poses are measured wrongly in the same way in each frame.
struct Walk {
    scene: Scene,
    filter: Filter,
    known: BTreeMap<u64, usize>,
    errors: [Vector6<f64>; 2],
    frame: usize,
}

impl Walk {
    fn new(seed: u64) -> Self {
        let settings = settings(&[
            ("estimator.mode", name("collab-tight")),
            ("worn.bias_time", Value::Float(1e5)),
            ("worn.common_share", Value::Float(SHARE)),
        ]);
        let scene = Scene::new(seed, 30);
        let filter = scene.filter(settings);
        Self {
            scene,
            filter,
            known: BTreeMap::new(),
            errors: time_correlated_errors(&mut rng(1000 + seed)),
            frame: 0,
        }
    }

    /// The view of one person, whose pose is off by what lasts besides the scene's noise.
    fn seen_by(&self, who: usize, view: WornObservation) -> WornObservation {
        let mut into_f = Matrix6::zeros();
        let back = view.t_cf.rotation.transpose();
        into_f.fixed_view_mut::<3, 3>(0, 0).copy_from(&back);
        into_f.fixed_view_mut::<3, 3>(3, 3).copy_from(&back);
        let time_correlated = Matrix6::from_diagonal(&time_correlated_sd().map(|s| s * s));
        WornObservation {
            who,
            t_cf: view.t_cf.retract(&-(into_f * self.errors[who])),
            covariance: view.covariance + time_correlated,
            bias: Some(time_correlated),
            ..view
        }
    }

    fn step(&mut self) {
        let t = self.frame as f64 * DT;
        self.filter.predict(t).unwrap();
        let (mut z, points) = self.scene.measure(t, &self.known, true);
        let (other, _) = self.scene.measure(t, &self.known, true);
        let found: Vec<u64> = z.bearings.iter().map(|b| b.id).collect();
        let first = z.views.remove(0);
        z.views.push(self.seen_by(0, first));
        let mut other = self.seen_by(1, other.views[0].clone());
        other
            .pairs
            .retain(|p| p.id.is_some_and(|id| found.contains(&id)));
        z.views.push(other);
        let report = self.filter.update(&z).unwrap();
        adopt(&mut self.known, &report, &points);
        self.frame += 1;
    }

    fn end_submap(&mut self) -> (Option<Edge>, DMatrix<f64>) {
        let seen: Vec<u64> = self.known.keys().copied().collect();
        let ended = self.filter.end_submap(&seen).unwrap();
        (ended.edge, ended.transferred)
    }
}

#[test]
fn what_lasts_of_each_persons_error_is_transferred_with_what_they_have_in_common() {
    let mut walk = Walk::new(3);
    for _ in 0..10 {
        walk.step();
    }
    // Each error is as uncertain as it was stated less what its views have told. A third person was never seen.
    let (none, transferred) = walk.end_submap();
    assert!(none.is_none());
    assert_eq!(transferred.nrows(), transferred_dim(3));
    let first = transferred.fixed_view::<12, 12>(1, 1).into_owned();
    assert_less(&first, &stated());
    assert_eq!(transferred.rows(13, 6).amax(), 0.0);
    for _ in 0..10 {
        walk.step();
    }
    let (edge, after) = walk.end_submap();
    let p = edge.unwrap().covariance;
    assert_eq!(p.nrows(), 6 + 2 * transferred_dim(3));
    // Views teach something of what was transferred, the way hangs together with it, and it is the same person's at the end.
    let (begin, end) = (7, 7 + transferred_dim(3));
    for person in [0, 6] {
        let learnt = p[(begin + person, begin + person)] / stated()[(person, person)];
        assert!((0.01..0.99).contains(&learnt), "{person}: {learnt}");
        let with_way = p.view((0, begin + person), (6, 6)).amax();
        assert!(with_way > 1e-6, "{person}: {with_way:e}");
        let sds = p[(begin + person, begin + person)] * p[(end + person, end + person)];
        let same = p[(begin + person, end + person)] / sds.sqrt();
        assert!((0.3..1.0).contains(&same), "{person}: {same}");
    }
    assert_less(&after.fixed_view::<12, 12>(1, 1).into_owned(), &first);
}

/// That each number is less uncertain.
fn assert_less(now: &SMatrix<f64, 12, 12>, before: &SMatrix<f64, 12, 12>) {
    for i in 0..12 {
        let left = now[(i, i)] / before[(i, i)];
        assert!((0.01..0.999).contains(&left), "{i}: {left}");
    }
}

/// Edges of a walk on which the persons' errors, and nothing else, last: `by` is what they do to each edge's pose.
fn edges(truth: &[Pose], by: &SMatrix<f64, 6, 12>, rng: &mut Pcg64) -> Vec<Edge> {
    let root = stated().cholesky().unwrap().l();
    let mut errors = root * draw::<12>(rng);
    let transferred = transferred_dim(2);
    let make = |pair: &[Pose]| {
        let noise = Vector6::from(EDGE_SD).component_mul(&draw::<6>(rng));
        let exact = pair[0].inverse().compose(&pair[1]);
        // The truth is what was measured with its error appended.
        let pose = exact.compose(&Pose::exp(&(noise + by * errors)).inverse());
        errors = errors * STAYS + root * draw::<12>(rng) * (1.0 - STAYS * STAYS).sqrt();
        let mut grow = DMatrix::zeros(6 + 2 * transferred, 24);
        grow.view_mut((0, 0), (6, 12)).copy_from(by);
        grow.view_mut((7, 0), (12, 12)).fill_with_identity();
        grow.view_mut((7 + transferred, 12), (12, 12))
            .fill_with_identity();
        let mut joint = DMatrix::zeros(24, 24);
        for (i, j, stays) in [(0, 0, 1.0), (12, 12, 1.0), (0, 12, STAYS), (12, 0, STAYS)] {
            let block = stated() * stays;
            joint.view_mut((i, j), (12, 12)).copy_from(&block);
        }
        let mut covariance = &grow * joint * grow.transpose();
        for (i, sd) in EDGE_SD.iter().enumerate() {
            covariance[(i, i)] += sd * sd;
        }
        Edge {
            pose,
            revised: DVector::zeros(transferred),
            covariance,
        }
    };
    truth.windows(2).map(make).collect()
}

/// Mean NEES in the middle of a straight way, at its end, and from one submap to a later one.
fn chains(change: impl Fn(&mut Edge)) -> [f64; 3] {
    let (length, draws) = (20, 60);
    let at = |k: usize| Pose::exp(&Vector6::new(0.0, 0.0, 0.5 * k as f64, 0.0, 0.0, 0.0));
    let truth: Vec<Pose> = (0..length).map(at).collect();
    // The first person's error shifts each edge to the side, the second's shifts it up and along.
    let mut by = SMatrix::<f64, 6, 12>::zeros();
    for (row, column) in [(0, 0), (1, 7), (2, 8)] {
        by[(row, column)] = 1.0;
    }
    let mut sums = [0.0; 3];
    for seed in 0..draws {
        let mut edges = edges(&truth, &by, &mut rng(seed));
        edges.iter_mut().for_each(&change);
        let transferred = edges[0].revised.len();
        let first = Node::at(truth[0].clone(), transferred);
        let fixed = Factor::pose(None, 0, &first.pose, &Matrix6::zeros()).unwrap();
        let (mut nodes, mut factors) = (vec![first], vec![fixed]);
        for (k, edge) in edges.iter().enumerate() {
            factors.push(Factor::between(k, k + 1, edge).unwrap());
            nodes.push(Node::at(nodes[k].pose.compose(&edge.pose), transferred));
        }
        let n = 6 + transferred;
        let last = edges[0].covariance.view((n, n), (transferred, transferred));
        factors.push(Factor::transferred(truth.len() - 1, &last.into_owned()).unwrap());
        let mut graph = PoseGraph::new(nodes, factors).unwrap();
        graph.solve().unwrap();
        let marginals = graph.marginals().unwrap();
        for (sum, k) in sums.iter_mut().zip([9, 19]) {
            let p = marginals.of_node(k).fixed_view::<6, 6>(0, 0).into_owned();
            *sum += nees(&graph.nodes()[k].pose, &truth[k], &p);
        }
        let (between, p) = marginals.relative(5, 15);
        sums[2] += nees(&between, &truth[5].inverse().compose(&truth[15]), &p);
    }
    sums.map(|sum| sum / draws as f64)
}

#[test]
fn a_chain_carries_each_persons_error_over() {
    let consistent = chains(|_| {});
    assert!(
        consistent.iter().all(|n| BAND.contains(n)),
        "{consistent:?}"
    );
    // With the first person's alone, each submap draws the second's anew.
    let first_alone = chains(|edge| {
        let kept = transferred_dim(1);
        let of_both = transferred_dim(2);
        let keep: Vec<usize> = (0..6 + kept)
            .chain(6 + of_both..6 + of_both + kept)
            .collect();
        let p = &edge.covariance;
        edge.covariance = DMatrix::from_fn(keep.len(), keep.len(), |i, j| p[(keep[i], keep[j])]);
        edge.revised = Transferred::zeros(kept);
    });
    println!(
        "NEES of chains: both transferred {consistent:.1?}, the first alone {first_alone:.1?}"
    );
    assert!(first_alone.iter().all(|n| *n > 10.0), "{first_alone:?}");
}
