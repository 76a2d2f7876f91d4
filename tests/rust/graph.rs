//! The graph of poses: its solution and its covariances against brute force, and against chance.

use ekf_core::EkfError;
use ekf_core::graph::{Edge, Factor, Node, PoseGraph, Transferred};
use ekf_core::math::pose::Pose;
use nalgebra::{DMatrix, Matrix6, SVector, Vector3, Vector6};
use rand::SeedableRng;
use rand_distr::{Distribution, StandardNormal};
use rand_pcg::Pcg64;
use std::f64::consts::TAU;

/// Numbers that a submap of one worn camera transfers, and numbers of its node.
const TRANSFERRED: usize = 7;
const NODE: usize = 6 + TRANSFERRED;

pub(crate) fn draw<const N: usize>(rng: &mut Pcg64) -> SVector<f64, N> {
    SVector::from_fn(|_, _| StandardNormal.sample(rng))
}

/// Two laps of a round walk, looking ahead.
fn walk(nodes: usize) -> Vec<Pose> {
    let lap = nodes / 2;
    let radius = lap as f64 * 0.5 / TAU;
    let at = |i: usize| {
        let angle = TAU * i as f64 / lap as f64;
        let turn = Pose::exp(&Vector6::new(0.0, 0.0, 0.0, 0.0, angle, 0.0));
        let place = Vector3::new(radius * (1.0 - angle.cos()), 0.0, radius * angle.sin());
        Pose {
            rotation: turn.rotation,
            translation: place,
        }
    };
    (0..nodes).map(at).collect()
}

/// What a filter would have measured on a walk whose scale is wrong by something that wanders slowly.
struct Measured {
    edges: Vec<Edge>,
    start: Vec<Node>,
    loops: Vec<(usize, usize, Pose)>,
    last: DMatrix<f64>,
}

pub(crate) const EDGE_SD: [f64; 6] = [0.005, 0.005, 0.005, 0.002, 0.002, 0.002];
const LOOP_SD: f64 = 0.005;
const SCALE_SD: f64 = 0.05;
/// Share of what is transferred that stays from one submap to the next.
pub(crate) const STAYS: f64 = 0.995;

fn measure(truth: &[Pose], loops: usize, rng: &mut Pcg64) -> Measured {
    let variance = SCALE_SD * SCALE_SD;
    let mut handed = SCALE_SD * draw::<1>(rng)[0];
    let mut edges = Vec::new();
    let mut start = vec![Node::at(truth[0].clone(), TRANSFERRED)];
    for pair in truth.windows(2) {
        let exact = pair[0].inverse().compose(&pair[1]);
        let noise = Vector6::from(EDGE_SD).component_mul(&draw::<6>(rng));
        let mut by_scale = Vector6::zeros();
        by_scale
            .fixed_rows_mut::<3>(0)
            .copy_from(&(exact.rotation.transpose() * exact.translation));
        // The truth is what was measured with its error appended.
        let pose = exact.compose(&Pose::exp(&(noise + by_scale * handed)).inverse());
        let mut covariance = DMatrix::zeros(20, 20);
        let own = Matrix6::from_diagonal(&Vector6::from(EDGE_SD).map(|s| s * s));
        covariance
            .fixed_view_mut::<6, 6>(0, 0)
            .copy_from(&(own + by_scale * variance * by_scale.transpose()));
        for (at, share) in [(6, 1.0), (NODE, STAYS)] {
            let with = by_scale * (variance * share);
            covariance.fixed_view_mut::<6, 1>(0, at).copy_from(&with);
            covariance
                .fixed_view_mut::<1, 6>(at, 0)
                .copy_from(&with.transpose());
            covariance[(at, at)] = variance;
        }
        covariance[(6, NODE)] = STAYS * variance;
        covariance[(NODE, 6)] = STAYS * variance;
        start.push(Node::at(
            start[start.len() - 1].pose.compose(&pose),
            TRANSFERRED,
        ));
        let revised = Transferred::zeros(TRANSFERRED);
        edges.push(Edge {
            pose,
            revised,
            covariance,
        });
        handed = STAYS * handed + (1.0 - STAYS * STAYS).sqrt() * SCALE_SD * draw::<1>(rng)[0];
    }
    let lap = truth.len() / 2;
    let close = |k: usize| {
        let from = k * (lap - 1) / loops.max(1);
        let exact = truth[from].inverse().compose(&truth[from + lap]);
        (from, from + lap, exact.retract(&(draw::<6>(rng) * LOOP_SD)))
    };
    let loops = (0..loops).map(close).collect();
    let mut last = DMatrix::zeros(TRANSFERRED, TRANSFERRED);
    last[(0, 0)] = variance;
    Measured {
        edges,
        start,
        loops,
        last,
    }
}

fn graph(measured: &Measured, change: impl Fn(&mut Edge)) -> PoseGraph {
    let first = &measured.start[0].pose;
    let mut factors = vec![Factor::pose(None, 0, first, &Matrix6::zeros()).unwrap()];
    for (k, edge) in measured.edges.iter().enumerate() {
        let mut edge = edge.clone();
        change(&mut edge);
        factors.push(Factor::between(k, k + 1, &edge).unwrap());
    }
    let end = measured.edges.len();
    factors.push(Factor::transferred(end, &measured.last).unwrap());
    for (from, to, pose) in &measured.loops {
        let p = Matrix6::identity() * LOOP_SD * LOOP_SD;
        factors.push(Factor::pose(Some(*from), *to, pose, &p).unwrap());
    }
    PoseGraph::new(measured.start.clone(), factors).unwrap()
}

pub(crate) fn nees(estimate: &Pose, truth: &Pose, covariance: &Matrix6<f64>) -> f64 {
    let error = estimate.inverse().compose(truth).log();
    error.dot(&covariance.cholesky().unwrap().solve(&error))
}

/// By how far nodes are off, seen from those a lap before: their mean, metres.
fn a_lap_later(nodes: &[Node], truth: &[Pose]) -> f64 {
    let lap = nodes.len() / 2;
    let off = |k: usize| {
        let exact = truth[k].inverse().compose(&truth[k + lap]);
        let found = nodes[k].pose.inverse().compose(&nodes[k + lap].pose);
        (found.translation - exact.translation).norm()
    };
    (0..lap).map(off).sum::<f64>() / lap as f64
}

/// Mean NEES in the middle of a loop, at the end and between two submaps, and by how much the second lap is off the first, over
/// that before.
fn monte_carlo(loops: usize, change: impl Fn(&mut Edge)) -> ([f64; 3], f64) {
    let truth = walk(40);
    let (mut sums, mut ratio) = ([0.0; 3], 0.0);
    let draws = 60;
    for seed in 0..draws {
        let mut rng = Pcg64::seed_from_u64(seed);
        let measured = measure(&truth, loops, &mut rng);
        let mut graph = graph(&measured, &change);
        graph.solve().unwrap();
        let marginals = graph.marginals().unwrap();
        let pose = |i: usize| &graph.nodes()[i].pose;
        for (sum, node) in sums.iter_mut().zip([10, 39]) {
            let p = marginals
                .of_node(node)
                .fixed_view::<6, 6>(0, 0)
                .into_owned();
            *sum += nees(pose(node), &truth[node], &p);
        }
        let (between, p) = marginals.relative(12, 33);
        let exact = truth[12].inverse().compose(&truth[33]);
        sums[2] += nees(&between, &exact, &p);
        ratio += a_lap_later(graph.nodes(), &truth) / a_lap_later(&measured.start, &truth);
    }
    (sums.map(|s| s / draws as f64), ratio / draws as f64)
}

/// Four standard deviations of the mean of 60 draws of chi-square with 6 degrees of freedom: sqrt(12 / 60) each.
pub(crate) const BAND: std::ops::Range<f64> = 4.2..7.8;

#[test]
fn its_covariances_are_consistent_with_and_without_loops() {
    for loops in [0, 4] {
        let (nees, ratio) = monte_carlo(loops, |_| {});
        println!("{loops} loops: NEES {nees:.1?}, error {ratio:.2} of before");
        assert!(nees.iter().all(|n| BAND.contains(n)), "{loops}: {nees:?}");
        if loops > 0 {
            assert!(ratio < 0.5, "{ratio}");
        }
    }
}

#[test]
fn a_scale_that_is_not_carried_over_makes_it_too_sure() {
    let (nees, _) = monte_carlo(0, |edge| {
        for at in [6, NODE] {
            for i in (0..20).filter(|&i| i != at) {
                edge.covariance[(i, at)] = 0.0;
                edge.covariance[(at, i)] = 0.0;
            }
        }
    });
    assert!(nees[0] > 10.0, "{nees:?}");
}

#[test]
fn a_chain_ends_where_its_edges_lead_with_the_covariance_that_they_add_up_to() {
    let truth = walk(12);
    let measured = measure(&truth, 0, &mut Pcg64::seed_from_u64(5));
    let mut graph = graph(&measured, |_| {});
    let solved = graph.solve().unwrap();
    assert!(solved.cost < 1e-15, "{solved:?}");
    // The same by hand: every edge's own noise, and one scale that wanders.
    let end = &measured.start[11].pose;
    let off = end.inverse().compose(&graph.nodes()[11].pose).log().amax();
    assert!(off < 1e-9, "{off:e}");
    let mut by_edges = DMatrix::<f64>::zeros(6, 6 * 11);
    for k in 0..11 {
        let rest = measured.start[k + 1].pose.inverse().compose(end);
        // A right perturbation of the edge k, seen at the end: METHOD 1's halves.
        let mut by = Matrix6::zeros();
        let back = rest.rotation.transpose();
        by.fixed_view_mut::<3, 3>(0, 0).copy_from(&back);
        by.fixed_view_mut::<3, 3>(3, 3).copy_from(&back);
        let arm = rest.translation.cross_matrix();
        by.fixed_view_mut::<3, 3>(0, 3).copy_from(&(-back * arm));
        by_edges.view_mut((0, 6 * k), (6, 6)).copy_from(&by);
    }
    let mut joint = DMatrix::<f64>::zeros(66, 66);
    for a in 0..11usize {
        for b in 0..11usize {
            let [sa, sb] = [a, b].map(|k| {
                let p = &measured.edges[k].covariance;
                p.fixed_view::<6, 1>(0, 6) / p[(6, 6)]
            });
            let shared = SCALE_SD * SCALE_SD * STAYS.powi(a.abs_diff(b) as i32);
            let mut block = sa * shared * sb.transpose();
            if a == b {
                block += Matrix6::from_diagonal(&Vector6::from(EDGE_SD).map(|s| s * s));
            }
            joint.view_mut((6 * a, 6 * b), (6, 6)).copy_from(&block);
        }
    }
    let expected = &by_edges * joint * by_edges.transpose();
    let p = graph.marginals().unwrap().of_node(11);
    let off = (p.fixed_view::<6, 6>(0, 0) - &expected).amax() / expected.amax();
    assert!(off < 1e-3, "{off:e}");
    assert!(
        expected[(0, 0)] + expected[(2, 2)] > 1e-4,
        "it is uncertain"
    );
}

#[test]
fn covariances_of_several_nodes_are_blocks_of_the_dense_inverse() {
    let truth = walk(8);
    let measured = measure(&truth, 1, &mut Pcg64::seed_from_u64(2));
    let mut graph = graph(&measured, |_| {});
    graph.solve().unwrap();
    let marginals = graph.marginals().unwrap();
    let all: Vec<usize> = (0..8).collect();
    let whole = marginals.of_nodes(&all);
    let some = marginals.of_nodes(&[6, 2]);
    for (a, i) in [6, 2].into_iter().enumerate() {
        for (b, j) in [6, 2].into_iter().enumerate() {
            let own = some.view((NODE * a, NODE * b), (NODE, NODE));
            let same = whole.view((NODE * i, NODE * j), (NODE, NODE));
            assert!((own - same).amax() < 1e-12);
        }
    }
    let (pose, p) = marginals.relative(2, 6);
    let exact = graph.nodes()[2]
        .pose
        .inverse()
        .compose(&graph.nodes()[6].pose);
    assert_eq!(pose, exact);
    assert!(p.cholesky().is_some());
    assert_eq!(marginals.relative(3, 3).1, Matrix6::zeros());
}

#[test]
fn a_loop_that_cannot_be_is_far_from_what_is_known() {
    let truth = walk(30);
    let measured = measure(&truth, 0, &mut Pcg64::seed_from_u64(9));
    let mut graph = graph(&measured, |_| {});
    graph.solve().unwrap();
    let marginals = graph.marginals().unwrap();
    let p = Matrix6::identity() * 1e-6;
    let exact = truth[2].inverse().compose(&truth[17]);
    let wrong = exact.retract(&Vector6::new(0.0, 0.0, 3.0, 0.0, 0.0, 0.0));
    let distance = |pose: &Pose| {
        let factor = Factor::pose(Some(2), 17, pose, &p).unwrap();
        graph.distance(&factor, &marginals).unwrap()
    };
    let limit = ekf_core::chi2::quantile(0.9999, 6.0);
    assert!(distance(&exact) < limit, "{}", distance(&exact));
    assert!(distance(&wrong) > 3.0 * limit, "{}", distance(&wrong));
}

#[test]
fn what_follows_a_node_is_corrected_by_what_the_node_transferred_wrongly() {
    let truth = walk(20);
    let measured = measure(&truth, 0, &mut Pcg64::seed_from_u64(4));
    let (head, next) = (&measured.edges[..18], &measured.edges[18]);
    let short = Measured {
        edges: head.to_vec(),
        start: measured.start[..19].to_vec(),
        loops: vec![(2, 12, truth[2].inverse().compose(&truth[12]))],
        last: measured.last.clone(),
    };
    // A third lap would be needed for the scale; a pose known from outside does it at once.
    let mut graph = graph(&short, |_| {});
    let far = Factor::pose(None, 5, &truth[5], &(Matrix6::identity() * 1e-6)).unwrap();
    let factors = [graph.factors().to_vec(), vec![far]].concat();
    graph = PoseGraph::new(graph.nodes().to_vec(), factors).unwrap();
    graph.solve().unwrap();
    let marginals = graph.marginals().unwrap();
    let onward = marginals.posed_node(18).onward(next).unwrap();
    // The same as one node more.
    let mut factors = graph.factors().to_vec();
    factors.retain(|f| f.weight.nrows() != TRANSFERRED);
    factors.push(Factor::between(18, 19, next).unwrap());
    factors.push(Factor::transferred(19, &measured.last).unwrap());
    let mut nodes = graph.nodes().to_vec();
    nodes.push(onward.node.clone());
    let mut longer = PoseGraph::new(nodes, factors).unwrap();
    longer.solve().unwrap();
    let same = longer.marginals().unwrap().posed_node(19);
    let off = same.node.pose.inverse().compose(&onward.node.pose).log();
    assert!(off.amax() < 1e-6, "{off}");
    let off = &same.node.transferred - &onward.node.transferred;
    assert!(off.amax() < 1e-6, "{off}");
    let sd = same.covariance.diagonal().map(f64::sqrt);
    // Of the pose and the scale: there is no bias here.
    for i in 0..7 {
        for j in 0..7 {
            let off = (&same.covariance - &onward.covariance)[(i, j)] / (sd[i] * sd[j]);
            assert!(off.abs() < 1e-3, "{i} {j}: {off:e}");
        }
    }
    let moved = graph.nodes()[18].transferred[0].abs();
    assert!(moved > 0.1 * SCALE_SD, "the scale was found wrong: {moved}");
}

#[test]
fn what_is_tied_to_nothing_and_factors_of_no_node_are_refused() {
    let nodes = vec![Node::at(Pose::identity(), TRANSFERRED); 2];
    let tied = Factor::pose(None, 0, &Pose::identity(), &Matrix6::identity()).unwrap();
    let mut graph = PoseGraph::new(nodes.clone(), vec![tied.clone()]).unwrap();
    let refused = |e: EkfError| matches!(e, EkfError::NotPositiveDefinite { .. });
    assert!(refused(graph.solve().unwrap_err()));
    assert!(refused(graph.marginals().unwrap_err()));
    assert_eq!(graph.nodes(), nodes);
    for (first, second) in [(Some(0), 2), (Some(1), 1), (Some(5), 1)] {
        let factor = Factor {
            first,
            second,
            ..tied.clone()
        };
        let graph = PoseGraph::new(nodes.clone(), vec![factor]);
        assert!(matches!(graph, Err(EkfError::InvalidInput { .. })));
    }
    let mut factor = tied.clone();
    factor.pose.translation.x = f64::NAN;
    let graph = PoseGraph::new(nodes.clone(), vec![factor]);
    assert!(matches!(graph, Err(EkfError::NonFinite { .. })));
    let mut factor = tied;
    factor.weight = DMatrix::zeros(6, 8);
    let graph = PoseGraph::new(nodes, vec![factor]);
    assert!(matches!(graph, Err(EkfError::InvalidInput { .. })));
    let none = Factor::pose(None, 0, &Pose::identity(), &(-Matrix6::identity()));
    assert!(refused(none.unwrap_err()));
}

#[test]
fn a_bent_chain_is_solved_from_far_off_and_the_same_again() {
    let truth = walk(200);
    let measured = measure(&truth, 6, &mut Pcg64::seed_from_u64(1));
    let solve = || {
        let mut graph = graph(&measured, |_| {});
        let solved = graph.solve().unwrap();
        (graph.nodes().to_vec(), solved)
    };
    let (nodes, solved) = solve();
    assert!(solved.steps < 20, "{solved:?}");
    // 199 edges and 6 loops of 6, each against its own noise; the scale's 200 are free.
    assert!((0.2..3.0).contains(&(solved.cost / 36.0)), "{solved:?}");
    let (off, before) = (
        a_lap_later(&nodes, &truth),
        a_lap_later(&measured.start, &truth),
    );
    assert!(off < before / 3.0, "{off} {before}");
    assert_eq!(solve().0, nodes);
}
