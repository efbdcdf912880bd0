"""Carry out the Dockerfile without an engine: its steps, one after the other, in bare Debian roots.

    sudo python3 deploy/bare_root.py FOLDER [--arg NAME=VALUE] [--bind PATH] [--env NAME] [--keep]

FOLDER gets one root per stage, the first made by ``debootstrap``. In the end the image's command
runs in the last root as its user, with every folder but its volumes and /tmp read-only, until its
health check passes; then it is asked to stop. Exit code 0 when all of that went well.

It knows the instructions that our Dockerfile uses and refuses others. ``--bind`` lends a folder of
this machine to all roots (wheels, certificates), ``--env`` a variable (``PIP_FIND_LINKS``).
"""

import argparse
import json
import os
import re
import shlex
import shutil
import signal
import subprocess
import sys
import time
from contextlib import suppress
from dataclasses import dataclass, field
from fnmatch import fnmatch
from pathlib import Path

CONTEXT = Path(__file__).resolve().parent.parent
MIRROR = "http://deb.debian.org/debian"
SHELL = ["/bin/sh", "-c"]
PATH = "/usr/local/sbin:/usr/local/bin:/usr/sbin:/usr/bin:/sbin:/bin"


@dataclass
class Stage:
    """A stage as far as it has been built."""

    root: Path
    env: dict[str, str] = field(default_factory=lambda: {"PATH": PATH})
    workdir: str = "/"
    user: str = "0"
    volumes: list[str] = field(default_factory=list)
    settings: dict[str, str] = field(default_factory=dict)


class Builder:
    """Carries out instructions; every command gets a private mount of what is lent."""

    def __init__(self, folder: Path, arguments: dict[str, str], binds: list[str]) -> None:
        self.folder = folder
        self.arguments = arguments
        self.binds = binds
        self.stages: dict[str, Stage] = {}
        self.stage: Stage | None = None

    def carry_out(self, word: str, rest: str) -> None:
        """Carry out one instruction; raises SystemExit where that fails or it is not known."""
        print(f"{word} {rest}"[:150], flush=True)
        if word == "FROM":
            self.begin(rest)
            return
        stage = self.stage
        assert stage is not None, "a Dockerfile begins with FROM"
        match word:
            case "RUN":
                self.run([*SHELL, rest])
            case "COPY":
                self.copy(rest)
            case "ENV":
                for pair in shlex.split(rest):
                    name, _, value = pair.partition("=")
                    stage.env[name] = re.sub(r"\$(\w+)", lambda m: stage.env.get(m[1], ""), value)
            case "ARG":
                name, _, value = shlex.split(rest)[0].partition("=")
                stage.env[name] = self.arguments.get(name, value)
            case "WORKDIR":
                stage.workdir = rest
                (stage.root / rest.lstrip("/")).mkdir(parents=True, exist_ok=True)
            case "USER":
                stage.user = rest
            case "VOLUME":
                stage.volumes.append(rest)
            case "HEALTHCHECK" | "ENTRYPOINT" | "CMD" | "STOPSIGNAL" | "EXPOSE":
                stage.settings[word] = rest
            case _:
                sys.exit(f"unknown instruction {word}")

    def begin(self, rest: str) -> None:
        """Begin a stage on a copy of what it builds on."""
        source, _, name = rest.partition(" AS ")
        root = self.folder / (name or "image")
        if root.exists():
            sys.exit(f"{root} exists already")
        base = self.stages.get(source)
        if base is None:
            match = re.fullmatch(r"debian:(\w+)-slim", source)
            if match is None:
                sys.exit(f"not a stage and no bare Debian: {source}")
            command = ["debootstrap", "--variant=minbase", match[1], str(root), MIRROR]
            subprocess.run(command, check=True, stdout=subprocess.DEVNULL)
            self.stage = Stage(root)
        else:
            subprocess.run(["cp", "-a", "--reflink=auto", str(base.root), str(root)], check=True)
            self.stage = Stage(root, dict(base.env), base.workdir)
        self.stages[name] = self.stage

    def copy(self, rest: str) -> None:
        """Copy from the context, less what .dockerignore names, or from another stage."""
        *sources, target = shlex.split(rest)
        assert self.stage is not None
        origin, ignored = CONTEXT, ignored_names()
        if sources[0].startswith("--from="):
            origin, ignored = self.stages[sources.pop(0).removeprefix("--from=")].root, []
        place = self.stage.root / os.path.join(self.stage.workdir, target).lstrip("/")
        for source in sources:
            path = origin / source.lstrip("/")
            if path.is_dir():
                shutil.copytree(
                    path,
                    place,
                    symlinks=True,
                    dirs_exist_ok=True,
                    ignore=lambda folder, names: [
                        name
                        for name in names
                        if is_ignored(str((Path(folder) / name).relative_to(origin)), ignored)
                    ],
                )
            else:
                to = place / path.name if target.endswith("/") or place.is_dir() else place
                to.parent.mkdir(parents=True, exist_ok=True)
                shutil.copy2(path, to)

    def run(self, command: list[str]) -> None:
        """Run a command in the stage's root; raises SystemExit when it fails."""
        done = subprocess.run(self.command(command))
        if done.returncode:
            sys.exit(f"exit code {done.returncode}: {shlex.join(command)[:200]}")

    def command(self, command: list[str], *, served: bool = False) -> list[str]:
        """Return what runs ``command`` in the root, mounts being its own.

        What is ``served`` finds all but volumes and /tmp read-only, and a network of its own.
        """
        stage = self.stage
        assert stage is not None
        root = shlex.quote(str(stage.root))
        script = ["ip link set lo up"] if served else []
        script += [f"mount --bind {root} {root}", f"mount -t proc proc {root}/proc"]
        script += [f"mount --rbind /dev {root}/dev", f"cp /etc/resolv.conf {root}/etc/resolv.conf"]
        for path in self.binds:
            inside = f"{root}{shlex.quote(path)}"
            script += [f"mkdir -p {inside}", f"mount --bind -o ro {shlex.quote(path)} {inside}"]
        if served:
            script += [f"mount -t tmpfs tmpfs {root}/tmp"]
            for volume in stage.volumes:
                inside = f"{root}{shlex.quote(volume)}"
                script += [f"mount --bind {inside} {inside}"]
            script += [f"mount -o remount,bind,ro {root}"]
            script += [f"mount -o remount,bind,rw {root}{shlex.quote(v)}" for v in stage.volumes]
        variables = [f"{name}={value}" for name, value in stage.env.items()]
        inner = f"cd {shlex.quote(stage.workdir)} && exec {shlex.join(command)}"
        user = f"--userspec={stage.user}:{stage.user}"
        script += [
            shlex.join(["exec", "chroot", user, str(stage.root), "env", "-i", *variables, *SHELL])
            + f" {shlex.quote(inner)}"
        ]
        own = ["--mount", "--propagation=private", *(["--net"] if served else [])]
        return ["unshare", *own, "sh", "-ec", "\n".join(script)]

    def serve(self) -> None:
        """Run the image's command until it is healthy, then stop it; raises SystemExit."""
        stage = self.stage
        assert stage is not None
        said = stage.settings
        program = json.loads(said["ENTRYPOINT"]) + json.loads(said["CMD"])
        check = json.loads(said["HEALTHCHECK"].partition("CMD ")[2])
        process = subprocess.Popen(self.command(program, served=True), start_new_session=True)
        beside = ["nsenter", f"--net=/proc/{process.pid}/ns/net", *self.command(check)]
        try:
            deadline_s = time.monotonic() + 120.0
            while subprocess.run(beside, stderr=subprocess.DEVNULL).returncode:
                if process.poll() is not None:
                    sys.exit(f"the console ended with exit code {process.returncode}")
                if time.monotonic() > deadline_s:
                    sys.exit("the console did not become healthy")
                time.sleep(2.0)
            print("healthy", flush=True)
            process.send_signal(getattr(signal, said.get("STOPSIGNAL", "SIGTERM")))
            code = process.wait(60.0)
            if code:
                sys.exit(f"asked to stop, the console ended with exit code {code}")
        finally:
            with suppress(ProcessLookupError):
                os.killpg(process.pid, signal.SIGKILL)


def ignored_names() -> list[str]:
    """Return the patterns of .dockerignore."""
    lines = (CONTEXT / ".dockerignore").read_text().splitlines()
    return [line.strip().rstrip("/") for line in lines if line.strip() and line[0] != "#"]


def is_ignored(path: str, patterns: list[str]) -> bool:
    """Return whether a pattern names ``path``: from the context's root, or ``**/`` anywhere."""
    return any(
        fnmatch(Path(path).name, pattern[3:]) if pattern.startswith("**/") else path == pattern
        for pattern in patterns
    )


def instructions() -> list[tuple[str, str]]:
    """Return the Dockerfile's instructions, continued lines joined."""
    text = (CONTEXT / "Dockerfile").read_text()
    lines = [line for line in text.splitlines() if not line.lstrip().startswith("#")]
    joined = re.sub(r"\\\n\s*", " ", "\n".join(lines))
    pairs = [line.split(maxsplit=1) for line in joined.splitlines() if line.strip()]
    return [(word, rest.strip()) for word, rest in pairs]


def main() -> None:
    """Carry out the Dockerfile."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("folder", type=Path, help="where the roots go; several GB")
    parser.add_argument("--arg", action="append", default=[], metavar="NAME=VALUE")
    parser.add_argument("--bind", action="append", default=[], metavar="PATH")
    parser.add_argument("--env", action="append", default=[], metavar="NAME")
    parser.add_argument("--keep", action="store_true", help="keep the roots")
    wanted = parser.parse_args()
    if os.geteuid() != 0:
        sys.exit("roots and mounts need root")
    wanted.folder.mkdir(parents=True, exist_ok=True)
    arguments = dict(pair.split("=", 1) for pair in wanted.arg)
    builder = Builder(wanted.folder.resolve(), arguments, wanted.bind)
    lent = {name: os.environ[name] for name in wanted.env}
    for word, rest in instructions():
        builder.carry_out(word, rest)
        if word == "FROM" and builder.stage is not None:
            builder.stage.env |= lent
    builder.serve()
    if not wanted.keep:
        for stage in builder.stages.values():
            shutil.rmtree(stage.root)


if __name__ == "__main__":
    main()
