"""A plan of the benchmark that takes seconds."""

from __future__ import annotations

PLAN = """
seeds: [0, 1]
defaults: {available: 0.4, modes: [mono, collab]}
recordings:
  walk: {worn: "lag:0.2", independent: [collab], reference: {system: other, ate_sim3_pct: 0.5}}
  same: {folder: walk, modes: [collab], settings: {filter: {map: {in_view: 20}}}}
  gone: {worn: rig}
  broken: {}
ablation:
  seeds: 0
  levers: {fewer: {filter.map.in_view: 20}, tight: {filter.estimator.mode: collab-tight}}
"""
