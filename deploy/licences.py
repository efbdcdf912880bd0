"""List the licences of all Python packages in this environment and of the dashboard's libraries.

One line each: name, version, licence. Ends with exit code 1 when a package names none. The
distribution's own packages have theirs in /usr/share/doc/NAME/copyright.
"""

import argparse
import json
import re
import sys
from importlib.metadata import Distribution, distributions
from pathlib import Path


def licence(package: Distribution) -> str:
    """Return the licence that a package's metadata names, empty when there is none."""
    told = package.metadata
    if expression := told.get("License-Expression"):
        return expression
    classes = [line.split(" :: ") for line in told.get_all("Classifier") or []]
    names = [
        words[-1] for words in classes if words[0] == "License" and words[-1] != "OSI Approved"
    ]
    if names:
        return ", ".join(names)
    # Some put the whole text here; its first line names it.
    text = (told.get("License") or "").strip()
    if text:
        return text.splitlines()[0][:80]
    # Others ship only the text.
    for file in package.files or []:
        if re.search(r"(?i)(^|/)(licen[cs]e|copying)[^/]*$", str(file)):
            lines = [line.strip() for line in file.read_text().splitlines() if line.strip()]
            return lines[0][:80] if lines else ""
    return ""


def main() -> int:
    """Print the list."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--lock", type=Path, help="the dashboard's package-lock.json")
    arguments = parser.parse_args()
    rows = {(p.metadata["Name"], p.version, licence(p)) for p in distributions()}
    if arguments.lock is not None:
        packages = json.loads(arguments.lock.read_text())["packages"]
        rows |= {
            (place.rpartition("node_modules/")[2], about["version"], about.get("license", ""))
            for place, about in packages.items()
            if place and not about.get("dev")
        }
    for name, version, words in sorted(rows, key=lambda row: row[0].lower()):
        print(f"{name} {version}: {words or 'NONE NAMED'}")
    return 0 if all(words for *_, words in rows) else 1


if __name__ == "__main__":
    sys.exit(main())
