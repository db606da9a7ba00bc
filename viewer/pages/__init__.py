"""The pages: what a visitor sees, and what each thing that can be done on them does."""
