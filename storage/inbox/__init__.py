"""An inbox: what waits in it, what is known of it, who scans it, what was bad."""
