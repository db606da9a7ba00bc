"""Looking after an archive: what of it is damaged, and what nothing refers to."""
