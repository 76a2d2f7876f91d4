//! Submaps: what is read off the filter against P by finite differences, and that reading changes nothing.

use crate::local::Pair;
use crate::scene::{Warm, warm};
use ekf_core::graph::{Edge, Factor, Node, PoseGraph};
use ekf_core::math::pose::Pose;
use ekf_core::math::quat::{self, Quat};
use ekf_core::settings::Value;
use ekf_core::state::{Block, BlockKind, transferred_dim};
use ekf_core::{EkfError, Filter};
use nalgebra::{DMatrix, DVector, Vector3};

fn ids(filter: &Filter) -> Vec<u64> {
    let features = filter.state().layout().features();
    features.map(|b| b.id).collect()
}

fn pose_at(x: &[f64], at: usize) -> Pose {
    let q = Quat::from_column_slice(&x[at + 3..at + 7]);
    Pose::from_quat(Vector3::from_column_slice(&x[at..at + 3]), &(q / q.norm()))
}

/// `J P J^T` of a function of the mean, by central differences.
fn covariance_of(filter: &Filter, f: impl Fn(&[f64]) -> DVector<f64>) -> DMatrix<f64> {
    let state = filter.state();
    let mut x = state.mean().to_vec();
    let mut by = DMatrix::zeros(f(&x).len(), x.len());
    for i in 0..x.len() {
        let (e, was) = (1e-6, x[i]);
        x[i] = was + e;
        let to = f(&x);
        x[i] = was - e;
        let from = f(&x);
        x[i] = was;
        by.set_column(i, &((to - from) / (2.0 * e)));
    }
    &by * state.covariance().to_dense() * by.transpose()
}

/// What a submap of the scene's filter transfers.
const TRANSFERRED: usize = transferred_dim(3);

fn only(filter: &Filter, kind: BlockKind) -> Block {
    *filter.state().layout().of_kind(kind).next().unwrap()
}

fn go_on(warm: &mut Warm, frames: usize) {
    for k in 0..frames {
        warm.update(k.is_multiple_of(4));
        warm.next_frame();
    }
    warm.update(true);
}

fn near(a: &DMatrix<f64>, b: &DMatrix<f64>, share: f64, what: &str) {
    let off = (a - b).amax() / b.amax();
    assert!(off < share, "{what}: {off:e}");
}

#[test]
fn the_way_since_a_submap_began_has_the_covariance_that_p_gives_it() {
    let mut warm = warm(31, &[("worn.bias_share", Value::Float(0.4))]);
    warm.update(true);
    let seen = ids(&warm.filter);
    assert!(warm.filter.end_submap(&seen).unwrap().edge.is_none());
    warm.next_frame();
    go_on(&mut warm, 12);
    let filter = &warm.filter;
    let edge = filter.since_submap().unwrap();
    let clone = only(filter, BlockKind::Submap(TRANSFERRED)).offset;
    let handed = clone + 7;
    let x = filter.state().mean();
    let exact = pose_at(x, clone).inverse().compose(&pose_at(x, 0));
    assert!(exact.inverse().compose(&edge.pose).log().amax() < 1e-12);
    assert_eq!(edge.revised.as_slice(), &x[handed..handed + TRANSFERRED]);
    let expected = covariance_of(filter, |x| {
        let pose = pose_at(x, clone).inverse().compose(&pose_at(x, 0));
        let xi = exact.inverse().compose(&pose).log();
        let numbers = xi.iter().chain(&x[handed..handed + TRANSFERRED]);
        DVector::from_iterator(6 + TRANSFERRED, numbers.copied())
    });
    near(&edge.covariance, &expected, 1e-6, "edge");
    // The scale was learnt since: what was transferred is revised, and hangs together with the way.
    assert!(edge.revised[0] != 0.0);
    assert!(expected[(2, 6)] != 0.0 && expected[(8, 8)] > 0.0);
    filter.check().unwrap();
}

#[test]
fn landmarks_are_taken_down_as_they_stand_to_the_camera() {
    let mut warm = warm(32, &[]);
    go_on(&mut warm, 20);
    warm.filter.manage_map(&[]);
    let before = warm.filter.clone();
    let seen = ids(&before);
    let submap = warm.filter.end_submap(&seen).unwrap();
    assert!(submap.ids.len() > 8, "{}", submap.ids.len());
    let state = before.state();
    let blocks: Vec<Block> = submap
        .ids
        .iter()
        .map(|&id| *state.layout().find(id).unwrap())
        .collect();
    let points = |x: &[f64]| {
        let back = pose_at(x, 0).inverse();
        let points = blocks
            .iter()
            .map(|b| back.apply(&b.feature(x).point().unwrap()));
        let flat: Vec<f64> = points.flat_map(|p| [p.x, p.y, p.z]).collect();
        DVector::from_vec(flat)
    };
    let flat: Vec<f64> = submap.points.iter().flat_map(|p| [p.x, p.y, p.z]).collect();
    assert!((points(state.mean()) - DVector::from_vec(flat)).amax() < 1e-9);
    near(
        &submap.covariance,
        &covariance_of(&before, points),
        1e-5,
        "points",
    );
    // The scale is the one that the filter states.
    let scale = before.scale_sd().unwrap();
    assert!((submap.transferred[(0, 0)].sqrt() / scale - 1.0).abs() < 1e-9);
    // A point that is nearer by some share is an error of the scale: they hang together.
    let (mut along, mut all) = (0.0, 0.0);
    for (i, p) in submap.points.iter().enumerate() {
        let with = submap.with_transferred.fixed_view::<3, 1>(3 * i, 0);
        along += p.dot(&with) / p.norm_squared();
        all += 1.0;
    }
    let shared = along / all / submap.transferred[(0, 0)];
    assert!((shared - 1.0).abs() < 0.3, "{shared}");
}

#[test]
fn ending_submaps_changes_no_estimate() {
    let (mut with, mut without) = (warm(33, &[]), warm(33, &[]));
    for k in 0..60 {
        if k % 7 == 3 {
            let seen = ids(&with.filter);
            with.filter.end_submap(&seen).unwrap();
        }
        for warm in [&mut with, &mut without] {
            warm.update(false);
            for id in warm.filter.manage_map(&[]) {
                warm.known.remove(&id);
            }
            warm.next_frame();
        }
        assert_eq!(with.filter.pose(), without.filter.pose(), "frame {k}");
        assert_eq!(
            with.filter.pose_covariance(),
            without.filter.pose_covariance()
        );
    }
    let mean = without.filter.state().mean().to_vec();
    // However many have ended, the state has one beginning.
    let more = with.filter.state().mean().len() - mean.len();
    assert_eq!(more, 7 + TRANSFERRED);
    with.filter.check().unwrap();
}

#[test]
fn a_chain_of_submaps_leads_where_the_filter_is_and_is_as_sure_of_the_way() {
    let mut warm = warm(34, &[]);
    warm.update(true);
    let mut factors = Vec::new();
    let mut nodes: Vec<Node> = Vec::new();
    let mut last = None;
    for k in 0..9 {
        let seen = ids(&warm.filter);
        let submap = warm.filter.end_submap(&seen).unwrap();
        match &submap.edge {
            None => {
                factors.push(Factor::pose(None, 0, &submap.pose, &submap.pose_covariance).unwrap())
            }
            Some(edge) => factors.push(Factor::between(k - 1, k, edge).unwrap()),
        }
        nodes.push(Node::at(submap.pose.clone(), TRANSFERRED));
        last = Some(submap);
        warm.next_frame();
        go_on(&mut warm, 8);
        warm.next_frame();
        warm.update(false);
    }
    let last = last.unwrap();
    factors.push(Factor::transferred(8, &last.transferred).unwrap());
    let mut graph = PoseGraph::new(nodes, factors).unwrap();
    graph.solve().unwrap();
    let marginals = graph.marginals().unwrap();
    let p = marginals.of_node(8).fixed_view::<6, 6>(0, 0).into_owned();
    let off = last.pose.inverse().compose(&graph.nodes()[8].pose).log();
    let squared = off.dot(&p.cholesky().unwrap().solve(&off));
    assert!(squared < 6.0, "{squared}");
    let edge: Edge = warm.filter.since_submap().unwrap();
    let onward = marginals.posed_node(8).onward(&edge).unwrap();
    let p = onward.covariance.fixed_view::<6, 6>(0, 0).into_owned();
    let (rotation, translation) = warm.filter.pose();
    let now = Pose {
        rotation,
        translation,
    };
    let off = now.inverse().compose(&onward.node.pose).log();
    let squared = off.dot(&p.cholesky().unwrap().solve(&off));
    assert!(squared < 6.0, "{squared}");
    // A chain forgets what ties far poses together: it may be less sure than the filter, hardly more.
    let own = warm.filter.pose_covariance();
    for i in 0..6 {
        let ratio = p[(i, i)].sqrt() / own[(i, i)].sqrt();
        assert!((0.5..8.0).contains(&ratio), "{i}: {ratio}");
    }
}

#[test]
fn it_is_the_same_with_local_updates() {
    let mut pair = Pair::new(4, 120, "gauge", 0.0);
    let mut edges = 0;
    for frame in 0..90 {
        pair.step(frame);
        if frame % 15 != 14 {
            continue;
        }
        let seen = pair.plain.followed().to_vec();
        let [plain, local] =
            [&mut pair.plain, &mut pair.local].map(|filter| filter.end_submap(&seen).unwrap());
        let Some((a, b)) = plain.edge.zip(local.edge) else {
            continue;
        };
        edges += 1;
        assert!(a.pose.inverse().compose(&b.pose).log().amax() < 1e-7);
        let p = a.covariance.fixed_view::<6, 6>(0, 0).amax();
        let off = (&a.covariance - &b.covariance)
            .fixed_view::<6, 6>(0, 0)
            .amax();
        assert!(off < 1e-4 * p, "frame {frame}: {off:e} of {p:e}");
    }
    assert!(edges > 3);
}

#[test]
fn what_cannot_be_is_refused_and_a_filter_restored_knows_where_its_submap_began() {
    let scene = crate::scene::Scene::new(1, 20);
    let mut filter = scene.filter(crate::scene::settings(&[]));
    assert!(matches!(
        filter.end_submap(&[]),
        Err(EkfError::InvalidInput { .. })
    ));
    assert!(filter.since_submap().is_none());
    let mut warm = warm(35, &[]);
    warm.update(true);
    let before = warm.filter.snapshot();
    let unknown = warm.filter.end_submap(&[999_999]);
    assert_eq!(
        unknown.unwrap_err(),
        EkfError::UnknownFeature { id: 999_999 }
    );
    assert_eq!(warm.filter.snapshot(), before);
    warm.filter.end_submap(&[]).unwrap();
    warm.next_frame();
    go_on(&mut warm, 3);
    let mut restored = Filter::restore(&warm.filter.snapshot()).unwrap();
    assert_eq!(restored.snapshot(), warm.filter.snapshot());
    let [a, b] = [&mut restored, &mut warm.filter].map(|f| f.end_submap(&[]).unwrap());
    assert_eq!(a.edge.unwrap().covariance, b.edge.unwrap().covariance);
    let (rotation, _) = warm.filter.pose();
    assert!(quat::is_rotation(&rotation, 1e-9));
}
