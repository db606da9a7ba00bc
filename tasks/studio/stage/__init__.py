"""How generated performers are filmed."""
