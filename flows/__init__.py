"""Order: which stage follows which, on what. No arithmetic, no arrays."""

import os

# read by Prefect when it is first imported; what the user has set stays
os.environ.setdefault("PREFECT_SERVER_EPHEMERAL_STARTUP_TIMEOUT_SECONDS", "180")  # 20 s are usual
os.environ.setdefault("PREFECT_SERVER_ANALYTICS_ENABLED", "false")
