"""What a plan's recordings serve besides accuracy. NAME.json, NAME.md and NAME.png are its files."""

from __future__ import annotations

ACCURACY, ABLATION, DESCRIPTORS, BLACKOUT = "evaluate", "ablation", "descriptors", "blackout"
CHOOSE = "choose"

STUDIES = {
    ABLATION: "the plan's levers, changed one at a time, instead",
    DESCRIPTORS: "compare descriptors by viewpoint angle on pairs of views, instead (needs its extra surf)",
    BLACKOUT: "take a second away here and there and see how soon the camera is found again, instead",
}
