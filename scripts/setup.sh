#!/usr/bin/env bash
# Makes the virtual environment DIR with furrowmap (editable), its extras and a dependency group.
#   setup.sh DIR [GROUP [CONSTRAINTS]]        PYTHON=... names another interpreter than python3
# GROUP is dev by default, CONSTRAINTS is constraints.txt.
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."
venv=${1:?the folder of the virtual environment}
group=${2:-dev}
constraints=${3:-constraints.txt}
python=${PYTHON:-python3}
die() { printf '%s\n' "$@" >&2; exit 1; }

"$python" -c 'import sys; sys.exit(sys.version_info < (3, 11))' ||
  die "furrowmap needs Python 3.11 or newer; '$python' is not that." "Name another one: make PYTHON=/path/to/python3.11 ..."

# Debian ships venv's second half, ensurepip, in a package of its own.
if ! "$python" -c 'import ensurepip, venv' 2>/dev/null; then
  package=$("$python" -c 'import sys; print("python%d.%d-venv" % sys.version_info[:2])')
  [ "$(id -u)" = 0 ] && command -v apt-get >/dev/null ||
    die "'$python' cannot make virtual environments: Debian's package $package is missing." "Install it: sudo apt-get install $package"
  apt-get update -qq && DEBIAN_FRONTEND=noninteractive apt-get install -y -qq --no-install-recommends "$package" >/dev/null
fi

# An environment whose interpreter is gone (or whose checkout was moved) is made anew.
"$venv/bin/python" -c '' 2>/dev/null && "$venv/bin/pip" --version >/dev/null 2>&1 || "$python" -m venv --clear "$venv"
"$venv/bin/python" -m pip install -qq --constraint constraints.txt --upgrade pip
"$venv/bin/python" -m pip install -qq --no-compile --constraint "$constraints" --build-constraint constraints.txt \
  --editable ".[cluster,csf,notebooks,parquet,photo,postgis,remote,trials,xarray]" --group "$group"
