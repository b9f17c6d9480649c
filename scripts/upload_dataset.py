"""Upload a data set to a hub: what `specklegen store export --format parquet` wrote (only with `--really`).

    specklegen store export data/train.zarr --format parquet --out out
    python scripts/upload_dataset.py out you/your-speckle --licence cc-by-4.0
    python scripts/upload_dataset.py out you/your-speckle --licence cc-by-4.0 --really

Before anything is sent, the folder is checked: its card, its Croissant metadata, every file's SHA-256 as written there,
and nothing else in it. The licence, which only its owner can know, goes into the card. Sending needs huggingface_hub
(`pip install huggingface_hub`), and that you are logged in there.
"""

import argparse
import hashlib
import json
import re
from pathlib import Path

CARD = "README.md"
METADATA = "croissant.json"


def main() -> None:
    """Check, say, and send if asked to."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("folder", type=Path, help="what the export wrote")
    parser.add_argument("repository", help="owner/name on the hub")
    parser.add_argument("--licence", required=True, help="its identifier there, such as cc-by-4.0")
    parser.add_argument("--really", action="store_true", help="send; without it, only say what would be sent")
    chosen = parser.parse_args()
    if not re.fullmatch(r"[\w.-]+/[\w.-]+", chosen.repository):
        parser.error(f"repository must be owner/name; got {chosen.repository!r}")
    if wrong := findings(chosen.folder):
        parser.error("; ".join(wrong))
    files = sending(chosen.folder)
    for name, size in files.items():
        print(f"{size / 1e6:10.3f} MB  {name}")
    print(f"{sum(files.values()) / 1e6:10.3f} MB  to {chosen.repository}, licence {chosen.licence}")
    if chosen.really:
        send(chosen.folder, chosen.repository, chosen.licence)
    else:
        print("nothing was sent; --really sends it")


def findings(folder: Path) -> list[str]:
    """What keeps a folder from being sent, a line each."""
    missing = [name for name in (CARD, METADATA) if not (folder / name).is_file()]
    if missing:
        return [f"{folder} must hold {name}: write it with `specklegen store export --format parquet`"
                for name in missing]
    wrong = []
    if not (folder / CARD).read_text(encoding="utf-8").startswith("---\n"):
        wrong.append(f"{CARD} must begin with front matter")
    said = {}
    for entry in json.loads((folder / METADATA).read_text(encoding="utf-8"))["distribution"]:
        if "sha256" in entry:
            said[entry["contentUrl"]] = entry["sha256"]
    for name in sorted({file for file in sending(folder) if file.startswith("data/")} | said.keys()):
        if name not in said:
            wrong.append(f"{name} must stand in {METADATA}")
        elif not (folder / name).is_file():
            wrong.append(f"{name} must be there; {METADATA} names it")
        elif hashlib.sha256((folder / name).read_bytes()).hexdigest() != said[name]:
            wrong.append(f"{name} must have the SHA-256 that {METADATA} gives; export it again")
    return wrong


def sending(folder: Path) -> dict[str, int]:
    """Files that go to the hub, and their bytes."""
    found = [folder / CARD, folder / METADATA, *sorted((folder / "data").rglob("*.parquet"))]
    return {file.relative_to(folder).as_posix(): file.stat().st_size for file in found}


def licensed(card: str, licence: str) -> str:
    """The card with its licence, which stands in the front matter."""
    return card.replace("---\n", f"---\nlicense: {json.dumps(licence)}\n", 1)


def send(folder: Path, repository: str, licence: str) -> None:
    """Send the files in one commit."""
    from huggingface_hub import CommitOperationAdd, HfApi

    api = HfApi()
    api.create_repo(repository, repo_type="dataset", exist_ok=True)
    card = licensed((folder / CARD).read_text(encoding="utf-8"), licence)
    contents: dict[str, bytes | str] = {name: str(folder / name) for name in sending(folder)}
    contents[CARD] = card.encode()
    adds = [CommitOperationAdd(path_in_repo=name, path_or_fileobj=content) for name, content in contents.items()]
    api.create_commit(repository, adds, commit_message="specklegen store export", repo_type="dataset")


if __name__ == "__main__":
    main()
