"""The frame loop: images in, pose with covariance out (METHOD section 7)."""
