"""Files: the only package that opens one."""
