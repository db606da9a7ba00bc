# ruff: noqa: D100, T201

# %% [markdown]
# # shosa in ten minutes
#
# This file is a notebook in the percent format: Jupytext, VS Code and Spyder open it cell by cell,
# and `python docs/tutorial.py` runs it all. It writes into `shosa-tutorial` in the working
# directory. A first run compiles the kernels, which takes a few minutes.

# %%
from pathlib import Path

import storage
from flows.ingestion import run_ingestion
from storage.formats.pictures.pictures import write_png
from tasks.exporting.joints import write_joint_track
from tasks.rendering.figures import draw_overlay
from tasks.rendering.views import render_take
from tasks.retrieval.answering import find_matches
from tasks.studio.cameras import RingSettings, generate_cameras
from tasks.studio.dancing.choreography import lonely, okuri48, wait
from tasks.studio.dancing.openings import stretch_arms_first
from tasks.studio.filming import FilmSettings, film_capture
from tasks.studio.performances import SH, TK, generate_performance

folder = Path("shosa-tutorial")
recordings = folder / "recordings"
recordings.mkdir(parents=True, exist_ok=True)

# %% [markdown]
# ## Recordings
#
# With recordings of your own this part falls away: put C3D, TRC and BVH files and captures into a
# folder. Here two generated performers dance "Okuri 48", on two days each, and a `.toml` beside
# each file says who danced what.

# %%
for performer in (TK, SH):
    for day in (1, 2):
        performance = generate_performance(
            [wait(), okuri48(), lonely(), okuri48()], performer, day=day, rate_hz=30.0
        )
        file = recordings / f"okuri48-{performer.name.lower()}-day{day}.trc"
        write_joint_track(file, performance.position, performance.rate_hz)
        about = f'[take]\ntitle = "Okuri 48"\nperformer = "{performer.name}"\n'
        file.with_suffix(".toml").write_text(about, encoding="utf-8")

# %% [markdown]
# A capture is a folder with the films of calibrated cameras. This one is small: twelve frames from
# six cameras of 160 x 120 pixels. The performer begins with the arms stretched sideways.

# %%
capture = recordings / "filmed"
if not capture.exists():
    film_capture(
        capture,
        stretch_arms_first(performance.position, performance.rate_hz)[:12],
        performance.rate_hz,
        cameras=generate_cameras(
            RingSettings(cameras=6, size=(160, 120)), center_m=(0.0, 0.9, 0.0)
        ),
        settings=FilmSettings(voxel_m=0.025),
        metadata={"title": "Okuri 48, filmed", "performer": performer.name},
    )

# %% [markdown]
# ## From recordings to an archive
#
# `run_ingestion` is what `shosa ingest` runs. Run it again, and everything is "unchanged". For a
# file that cannot be used, `reason` says why.

# %%
for outcome in run_ingestion(str(folder / "archive"), [str(recordings)]):
    print(outcome.status, outcome.take, outcome.frames, outcome.reason)

# %% [markdown]
# ## A take
#
# A take's arrays are labeled xarray objects, in metres with Y up. They are read when used.

# %%
archive = storage.open_archive(folder / "archive")
print(archive.takes())

take = archive.take("okuri48-tk-day1")
motion = take.motion
print(motion)

right_foot = motion["position"].sel(joint="RFoot")
print("the right foot rises to", float(right_foot.sel(space="y").max()), "m")

# %% [markdown]
# ## Search
#
# The query is a clip of a take: frames are counted from 0, and both ends belong to it. The answer
# is a pandas table, the nearest match first; the first match is the query itself. A distance of
# 0.02 is 3 cm on a performer of 1.6 m.

# %%
asked = generate_performance([wait(), okuri48(), lonely(), okuri48()], TK, day=1, rate_hz=30.0)
clip = asked.clips[1]
table = find_matches(archive, f"{take.name}:{clip.start}-{clip.end}", top=8)
print(table.to_string(index=False))

# %% [markdown]
# By the feet alone, in the takes of one performer, and left and right exchanged too:

# %%
feet = find_matches(
    archive, f"{take.name}:{clip.start}-{clip.end}", part="feet", mirror=True, takes="*-sh-*"
)
print(feet.to_string(index=False))

# %% [markdown]
# ## Pictures
#
# With matplotlib installed, `right_foot.plot.line(x="time")` draws the foot over time. It is no
# part of shosa's environment, so here is the height of the foot as an SVG file, a millimetre a
# pixel, with the query and its repeat shaded.

# %%
heights_m = right_foot.sel(space="y").values
own = table[table["take"] == take.name]
shades = "".join(
    f'<rect x="{start}" width="{end - start}" height="110" fill="#f3dac6"/>'
    for start, end in zip(own["start"], own["end"], strict=True)
)
points = " ".join(f"{frame},{100 - 1000 * height:.1f}" for frame, height in enumerate(heights_m))
svg = (
    f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {len(heights_m)} 110">'
    f'{shades}<polyline points="{points}" fill="none" stroke="#268c48"/></svg>'
)
(folder / "right-foot.svg").write_text(svg, encoding="utf-8")

# %% [markdown]
# The nearest match of another performer laid over the query, as the search compares them: blue and
# orange.

# %%
nearest = table[table["performer"] != "TK"].iloc[0]
other = archive.take(nearest["take"]).motion
image = draw_overlay(
    motion["position"].values[clip.start : clip.end + 1],
    other["position"].values[nearest["start"] : nearest["end"] + 1],
    query_stature_m=motion.attrs["stature_m"],
    match_stature_m=other.attrs["stature_m"],
    names=("TK", nearest["performer"]),
)
write_png(folder / "overlay.png", image)

# %% [markdown]
# ## Voxels
#
# A capture has its films' voxels besides the motion: where they are, their colors, and which of the
# 11 segments each belongs to (0 is what is not the performer). `render_take` shows them from where
# no camera stood.

# %%
filmed = archive.take("filmed")
print(filmed.record.stages)
voxels = filmed.voxels(5)
print(voxels)
if "label" in voxels:
    print(voxels["label"].to_series().value_counts().sort_index())
print(filmed.occupied(5).sum().item(), "voxels are occupied")
print(render_take(str(folder / "archive"), "filmed", str(folder / "filmed.png")))

# %% [markdown]
# ## Without shosa
#
# The archive is plain Zarr v3: any reader can open it, with the path that `take.path` gives.

# %%
print(f'xarray.open_zarr("{take.path}", group="motion", consolidated=False)')
