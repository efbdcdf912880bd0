"""Programs of others, each in an environment of its own."""

from __future__ import annotations

import subprocess
import sys
import venv
from pathlib import Path

import pytest
from programs import Peer


@pytest.fixture(scope="session")
def peer(request: pytest.FixtureRequest) -> Peer:
    """Installs a package into an environment of its own and returns its interpreter.

    What it needs is borrowed from ours; ``whole`` installs that as well, where ours lacks it.
    """

    def install(requirement: str, *, whole: bool = False) -> Path:
        assert request.config.cache is not None
        home = request.config.cache.mkdir("peers") / requirement.replace("==", "-")
        python = home / "bin" / "python"
        if (home / "ready").exists():
            return python
        venv.create(home, clear=True)
        if not whole:
            packages = next(home.glob("lib/python*/site-packages"))
            own = next(Path(sys.prefix).glob("lib/python*/site-packages"))
            # Looked at after the environment's own packages.
            (packages / "borrowed.pth").write_text(f"{own}\n")
        pip = [sys.executable, "-m", "pip", "--python", str(python), "install", "--quiet"]
        done = subprocess.run(
            [*pip, *([] if whole else ["--no-deps"]), requirement],
            capture_output=True,
            text=True,
            check=False,
        )
        if done.returncode != 0:
            pytest.skip(f"{requirement} cannot be installed here: {done.stderr.strip()[-200:]}")
        (home / "ready").touch()
        return python

    return install
