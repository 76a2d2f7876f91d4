"""What ``collabslam-lab evaluate`` does: a plan of recordings, run in parallel, resumed, and tabulated.

``plan`` reads the YAML, ``store`` knows what is done already, ``running`` does the rest in processes, and
``accuracy``, ``ablation``, ``descriptors`` and ``blackout`` make the pages.
"""
