#!/usr/bin/env python3
"""The command line: control and simulate welds, inspect bags, identify, tune, export, run campaigns."""

import sys

from _bootstrap import start

#: verbs of bag that sign or verify
SIGNING = ("keygen", "attest", "verify-evidence")

if __name__ == "__main__":
    extras = ["fmu", *(["compiler"] if "--platform" in sys.argv else [])] if sys.argv[1:3] == ["export", "fmu"] else []
    live = sys.argv[1:2] == ["demo"] and "--live" in sys.argv
    extras += ["hmi"] if live or sys.argv[1:3] == ["node", "hmi"] else []
    extras += ["machine"] if sys.argv[1:3] == ["node", "machine"] else []
    extras += ["campaign"] if sys.argv[1:2] == ["campaign"] else []
    extras += ["history"] if sys.argv[1:2] == ["history"] else []
    extras += ["completion"] if sys.argv[1:2] == ["completion"] else []
    signing = sys.argv[1:2] == ["bag"] and sys.argv[2:3] and sys.argv[2] in SIGNING
    by_procedure = any(argument.startswith("--procedure") for argument in sys.argv)
    extras += ["quality"] if signing or by_procedure or sys.argv[1:2] in (["record"], ["procedure"]) else []
    extras += ["canister"] if any("canister" in argument for argument in sys.argv[1:]) else []
    start("fsw.main", extras)
