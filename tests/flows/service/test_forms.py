"""What the forms of the dashboard offer, and what a scan every minute pays for."""

import subprocess
import sys
from typing import get_args


def test_the_parts_of_the_form_are_those_of_the_search():
    from flows.service.forms import Part
    from tasks.retrieval.normalization import PARTS

    assert set(get_args(Part)) == set(PARTS)


def test_a_scan_pays_for_no_stage():
    """It runs every minute, in a process of its own."""
    program = (
        "import sys; import flows.service.forms;"
        "slow = {'numba', 'xarray', 'zarr', 'scipy', 'cv2', 'av'} & set(sys.modules);"
        "sys.exit(f'imported {slow}' if slow else 0)"
    )
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr


def test_every_parameter_of_a_form_is_described():
    from prefect.utilities.callables import parameter_schema

    from flows.service import forms

    for flow in (forms.ingest, forms.digitize, forms.search, forms.gc):
        for name, said in parameter_schema(flow).properties.items():
            assert said.get("description") or "allOf" in said or "$ref" in said, (flow.name, name)
