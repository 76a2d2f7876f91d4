"""The error of T_CF that lasts, and the offset of its clock, fitted to a whole recording (METHOD section 26).

``seen`` asks the images of each view where Cf is, ``fit`` joins the views and says what they cannot tell, and
``recorded`` does both for a recording: ``collabslam check-calib --write``.
"""
