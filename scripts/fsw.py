#!/usr/bin/env python3
"""The command line: control and simulate welds, inspect bags, identify, tune, export, run campaigns."""

import sys

from _bootstrap import start

#: verbs of bag and procedure that sign or verify
SIGNING = ("keygen", "attest", "verify-evidence", "sign", "check")

if __name__ == "__main__":
    extras = ["fmu", *(["compiler"] if "--platform" in sys.argv else [])] if sys.argv[1:3] == ["export", "fmu"] else []
    live = sys.argv[1:2] == ["demo"] and "--live" in sys.argv
    extras += ["hmi"] if live or sys.argv[1:3] == ["node", "hmi"] else []
    extras += ["machine"] if sys.argv[1:3] == ["node", "machine"] else []
    extras += ["campaign"] if sys.argv[1:2] == ["campaign"] else []
    extras += ["history"] if sys.argv[1:2] == ["history"] else []
    extras += ["completion"] if sys.argv[1:2] == ["completion"] else []
    signing = sys.argv[1:2] in (["bag"], ["procedure"]) and sys.argv[2:3] and sys.argv[2] in SIGNING
    extras += ["quality"] if sys.argv[1:2] == ["record"] or signing else []
    extras += ["canister"] if any("canister" in argument for argument in sys.argv[1:]) else []
    start("fsw.main", extras)
