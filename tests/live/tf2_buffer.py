"""What tf2's own buffer makes of transforms, in a process of its own: Debian's tf2 brings messages of ROS 1.

``tf2_buffer.py FOLDER`` (where ``tf2_py`` lies) reads JSON: ``links`` as rows of parent, child, stamp, x y z
qx qy qz qw, and ``ask`` as rows of target, source, stamp; it prints the answers, x y z qx qy qz qw each.
"""

from __future__ import annotations

import json
import sys

sys.path.insert(0, sys.argv[1])

import genpy
import tf2_py
from geometry_msgs.msg import TransformStamped

asked = json.load(sys.stdin)
buffer = tf2_py.BufferCore(genpy.Duration(100.0))
for parent, child, stamp, *numbers in asked["links"]:
    link = TransformStamped()
    link.header.frame_id, link.child_frame_id = parent, child
    link.header.stamp = genpy.Time.from_sec(stamp)
    place, turn = link.transform.translation, link.transform.rotation
    place.x, place.y, place.z, turn.x, turn.y, turn.z, turn.w = numbers
    buffer.set_transform(link, "test")
answers = []
for target, source, stamp in asked["ask"]:
    found = buffer.lookup_transform_core(target, source, genpy.Time.from_sec(stamp)).transform
    place, turn = found.translation, found.rotation
    answers.append([place.x, place.y, place.z, turn.x, turn.y, turn.z, turn.w])
print(json.dumps(answers))
