"""What the exit codes of the command mean."""

DONE, WRONG_USE, BAD_INPUT, RUN_FAILED, INTERRUPTED = 0, 2, 3, 4, 130
