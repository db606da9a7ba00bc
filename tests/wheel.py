"""Make a wheel that carries its kernels: `python -m tests.wheel` writes one into build/wheel/.

They are compiled for a processor that nearly every machine of this kind has; who installs the wheel
on such a one, for the same Python and numba, waits for no compiler.
"""

import json
import os
import platform
import shutil
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).parent.parent
BUILT = ROOT / "build" / "wheel"
PACKAGES = ("flows", "tasks", "storage", "viewer")
FILES = ("pyproject.toml", "README.md", "LICENSE")

PROCESSORS = {
    "x86_64": (
        "x86-64-v3",
        "cx16,sahf,popcnt,sse3,sse4.1,sse4.2,ssse3,avx,avx2,bmi,bmi2,f16c,fma,lzcnt,movbe",
    ),
    "aarch64": ("generic", "neon"),
    "arm64": ("generic", "neon"),
}
"""By machine: the name and the features, as LLVM calls them, of what is compiled for. x86-64-v3 is
what processors of 2015 and later have."""

SAY = "import json; from tasks.engine import kernels; print(json.dumps(kernels.made_for()))"


def copy_tree(tree: Path) -> None:
    """Copy what a wheel is made of, without anything that was compiled."""
    for name in PACKAGES:
        shutil.copytree(ROOT / name, tree / name, ignore=shutil.ignore_patterns("__pycache__"))
    for name in FILES:
        shutil.copy(ROOT / name, tree / name)


def carry_kernels(tree: Path) -> None:
    """Compile the kernels of the packages in `tree`, and put them where these look for them."""
    name, features = PROCESSORS[platform.machine()]
    environment = {key: text for key, text in os.environ.items() if not key.startswith("NUMBA_")}
    environment |= {
        "NUMBA_CPU_NAME": name,
        "NUMBA_CPU_FEATURES": ",".join(f"+{each}" for each in features.split(",")),
        "PYTHONPATH": str(tree),
    }

    def run(*arguments: str) -> str:
        command = [sys.executable, *arguments]
        return subprocess.run(
            command, cwd=tree, env=environment, check=True, stdout=subprocess.PIPE, text=True
        ).stdout

    run("-m", "tasks.engine.compiling")
    carried = tree / "tasks" / "engine" / "carried"
    for kind in ("nbi", "nbc"):
        for file in sorted(tree.rglob(f"__pycache__/*.{kind}")):
            package = ".".join(file.parent.parent.relative_to(tree).parts)
            (carried / package).mkdir(parents=True, exist_ok=True)
            file.rename(carried / package / file.name)
    made = json.loads(run("-c", SAY))
    (carried / "target.json").write_text(json.dumps(made, indent=1) + "\n", "utf-8")


def main() -> None:
    """Make the wheel, and say where it is."""
    shutil.rmtree(BUILT, ignore_errors=True)
    tree = BUILT / "tree"
    copy_tree(tree)
    carry_kernels(tree)
    tag = f"--python-tag=cp{sys.version_info[0]}{sys.version_info[1]}"
    system = f"--plat-name={sys.platform}_{platform.machine()}"
    build = ["wheel", "--quiet", "--no-deps", f"--config-settings=--build-option={tag} {system}"]
    subprocess.run(
        [sys.executable, "-m", "pip", *build, "--wheel-dir", str(BUILT), str(tree)], check=True
    )
    shutil.rmtree(tree)
    sys.stdout.write("".join(f"{file.relative_to(ROOT)}\n" for file in BUILT.glob("*.whl")))


if __name__ == "__main__":
    main()
