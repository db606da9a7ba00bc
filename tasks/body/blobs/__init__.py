"""The joint fit of one frame: bones as blobs, one least-squares problem."""
