"""Every setting of every stage, by the name that a file of settings gives it.

A file has a table a stage (`[pose_fitting]`), with the settings of its parts in tables below it
(`[pose_fitting.paper]`). What it leaves out keeps its default. What a stage does not read is no
part of its key, so that another setting computes no more anew than what it changes.
"""

import difflib
from collections.abc import Iterator, Mapping
from dataclasses import asdict, dataclass, field, is_dataclass, replace
from typing import Any

from storage.errors import InputError
from tasks.body.initial.frames import InitialModelSettings
from tasks.body.joint_tracks import JointTrackSettings
from tasks.body.labels.provisional import ProvisionalSettings
from tasks.body.pose_fitting import PoseFittingSettings
from tasks.checks.agreement import AgreementSettings
from tasks.engine.settings import Setting, accepted_values, field_kinds, is_accepted, list_settings
from tasks.reconstruction.carving import CarvingSettings
from tasks.reconstruction.coloring import ColoringSettings
from tasks.reconstruction.silhouettes import SilhouetteSettings


@dataclass(frozen=True)
class Settings:
    """The settings of every stage from the films to the joints."""

    silhouettes: SilhouetteSettings = field(default_factory=SilhouetteSettings)
    agreement: AgreementSettings = field(default_factory=AgreementSettings)
    carving: CarvingSettings = field(default_factory=CarvingSettings)
    coloring: ColoringSettings = field(default_factory=ColoringSettings)
    initial_model: InitialModelSettings = field(default_factory=InitialModelSettings)
    pose_fitting: PoseFittingSettings = field(default_factory=PoseFittingSettings)
    provisional_labeling: ProvisionalSettings = field(default_factory=ProvisionalSettings)
    joint_tracks: JointTrackSettings = field(default_factory=JointTrackSettings)

    def that_are_read(self) -> "Settings":
        """Return the settings with those at their defaults that the method does not read."""
        labeling = self.provisional_labeling
        if self.pose_fitting.method == "joint" and not labeling.keep:
            labeling = ProvisionalSettings(keep=False)
        unread = "most_rings" if self.pose_fitting.method == "paper" else "most_rings_of_paper"
        return replace(
            self,
            pose_fitting=self.pose_fitting.read_by_method(),
            provisional_labeling=replace(
                labeling, **{unread: getattr(ProvisionalSettings(), unread)}
            ),
        )

    def for_labels(self) -> ProvisionalSettings:
        """Return how provisional labels are made, by the rings that the method asks for."""
        labeling = replace(self.provisional_labeling, keep=True)
        if self.pose_fitting.method == "paper":
            return replace(labeling, most_rings=labeling.most_rings_of_paper)
        return labeling


def all_settings(settings: Settings | None = None) -> list[Setting]:
    """Return every setting, with its value in `settings` (by default the defaults)."""
    return list(list_settings(settings or Settings()))


def changed_settings(settings: Settings) -> dict[str, Any]:
    """Return the settings that are not the defaults, by name (`pose_fitting.method`)."""
    usual = {each.name: each.value for each in all_settings()}
    return {
        each.name: each.value for each in all_settings(settings) if each.value != usual[each.name]
    }


def settings_of_stages(settings: Settings) -> dict[str, dict[str, Any]]:
    """Return the settings of each stage as JSON can hold them, by the stage's name."""
    return {name: dict(values) for name, values in asdict(settings).items()}


def read_settings(tables: Mapping[str, Any], file: str) -> Settings:
    """Return the defaults with what the tables of a file set.

    Parameters
    ----------
    tables
        As TOML has them.
    file
        How the file is called in messages.

    Raises
    ------
    InputError
        With every name that is unknown, and the nearest that is not; every value of another type
        or out of its range, and the range.
    """
    faults: list[str] = []
    settings = _replaced(Settings(), tables, "", faults)
    if faults:
        said = "".join(f"\n- {fault}" for fault in faults)
        raise InputError(f"{file} cannot be used; `shosa settings` prints all settings:{said}")
    return settings


def merge_tables(
    below: Mapping[str, Any], above: Mapping[str, Any], within: str = ""
) -> tuple[dict[str, Any], list[str]]:
    """Return tables in which `above` wins, and the names of what both set, to other values."""
    merged, both = dict(below), []
    for name, value in above.items():
        mine = merged.get(name)
        if isinstance(mine, Mapping) and isinstance(value, Mapping):
            merged[name], more = merge_tables(mine, value, f"{within}{name}.")
            both += more
            continue
        if name in merged and mine != value:
            both.append(f"{within}{name}")
        merged[name] = value
    return merged, both


def format_settings(settings: Settings | None = None) -> Iterator[str]:
    """Yield the lines of a TOML file with every setting, its range, meaning and reason."""
    table = None
    for each in all_settings(settings):
        stage, _, name = each.name.rpartition(".")
        if stage != table:
            yield from ([""] if table is not None else []) + [f"[{stage}]"]
            table = stage
        unit = f" [{each.unit}]" if each.unit else ""
        yield from _wrapped(f"{each.meaning}{unit} ({each.accepted})")
        if each.reason:
            yield from _wrapped(each.reason)
        yield f"{name} = {_toml_value(each.value)}"


def _replaced(settings: Any, tables: Any, within: str, faults: list[str]) -> Any:
    """Return a dataclass of settings with what a table sets; what is wrong goes to `faults`."""
    kinds, values = field_kinds(type(settings)), {}
    for name, value in tables.items():
        where = f"{within}{name}"
        if name not in kinds:
            faults.append(_unknown(where, name, list(kinds), within))
        elif is_dataclass(mine := getattr(settings, name)):
            if isinstance(value, Mapping):
                values[name] = _replaced(mine, value, f"{where}.", faults)
            else:
                faults.append(f"{where} is a table, write [{where}] and settings below it")
        elif not is_accepted(value, kinds[name]):
            faults.append(f"{where} = {value!r} should be {accepted_values(kinds[name])}")
        else:
            values[name] = float(value) if isinstance(mine, float) else value
    try:
        return replace(settings, **values)
    except ValueError as error:  # settings that do not go together
        faults.append(f"{within.rstrip('.')}: {error}")
        return settings


def _unknown(where: str, name: str, known: list[str], within: str) -> str:
    """Say that there is no such table or setting, and which is meant."""
    near = difflib.get_close_matches(name, known, n=1, cutoff=0.5)
    what = "setting" if within else "stage"
    meant = f"; {within}{near[0]} is meant?" if near else f"; there are {', '.join(known)}"
    return f"there is no {what} {where!r}{meant}"


def _wrapped(text: str, width: int = 96) -> list[str]:
    """Return a text as lines of a comment."""
    lines = [""]
    for word in text.split():
        if len(lines[-1]) + len(word) > width:
            lines.append("")
        lines[-1] += f" {word}"
    return [f"#{line}" for line in lines]


def _toml_value(value: Any) -> str:
    """Return a value as TOML writes it."""
    if isinstance(value, bool):
        return str(value).lower()
    return f'"{value}"' if isinstance(value, str) else repr(value)
