#!/usr/bin/env bash
# Makes, in the root of qgis_root.sh, the environment in which the plugin's worker runs: furrowmap from this checkout,
# editable, with the versions in constraints.txt, in that root's own Python (3.13). Made anew when these change.
# Prints the command furrowmap as it is named inside.
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."
root=$(scripts/qgis_root.sh)
environment=/opt/furrowmap
key=$(cat constraints.txt pyproject.toml | sha256sum | cut -c-16)-$(pwd -P | sha256sum | cut -c-8)
exec 9>"$root.worker.lock"
flock 9
if [ "$(cat "$root$environment/key" 2>/dev/null)" != "$key" ]; then
  echo "making the worker's environment in $root (log: $root.worker.log)" >&2
  scripts/in_qgis_root.sh sh -euc '
    rm -f "$1/key"
    [ -x "$1/bin/pip" ] || python3 -m venv --clear "$1"
    "$1/bin/pip" install -q --constraint constraints.txt --upgrade pip
    "$1/bin/pip" install -q --no-compile --constraint constraints.txt --build-constraint constraints.txt --editable .
    echo "$2" >"$1/key"' sh "$environment" "$key" >"$root.worker.log" 2>&1 9>&- ||
    { tail -n 20 "$root.worker.log" >&2; exit 1; }
fi
echo "$environment/bin/furrowmap"
