"""Order: which stage follows which, on what. No arithmetic, no arrays."""
