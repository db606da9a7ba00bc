"""Where face, hands and feet are, over the whole take."""
