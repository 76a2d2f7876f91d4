"""A worn camera made out of posed images of one camera, for development and scoring."""
