#!/usr/bin/env bash
# All set-up: system libraries, virtual environment, locked dependencies, this package.
set -euo pipefail
cd "$(dirname "$0")/.."
PYTHON=${PYTHON:-python3}
VENV=${VENV:-.venv}

scripts/system_libraries.sh
if ! "$PYTHON" -c 'import sys; sys.exit(sys.version_info < (3, 11))'; then
  echo "poil_drake needs Python 3.11 or newer; '$PYTHON' is $("$PYTHON" -V). Run: make setup PYTHON=python3.11" >&2
  exit 1
fi
[ -x "$VENV/bin/python" ] || "$PYTHON" -m venv "$VENV"
echo "installing locked dependencies into $VENV (about two minutes)"
"$VENV/bin/python" -m pip install -qq --disable-pip-version-check --no-compile \
  --constraint constraints.txt --editable '.[dev,cluster,vision]'
touch "$VENV/.complete"
