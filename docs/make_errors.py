"""Writes `docs/errors.md` from the classes of problems: `python docs/make_errors.py`."""

from __future__ import annotations

from pathlib import Path

from hierc.explain import reference

if __name__ == "__main__":
    Path(__file__).with_name("errors.md").write_text(reference(), encoding="utf-8")
