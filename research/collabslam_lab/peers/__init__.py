"""Other systems beside this one, on the same images in the same run; see `collabslam_lab.peers.compare`."""
