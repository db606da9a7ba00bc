"""How generated performers move."""
