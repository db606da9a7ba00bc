"""The command line: one sub-command a flow, or a look into an archive."""
