#!/usr/bin/env bash
# Installs, once, the readers of the web that the tests open products with (tests/node/package-lock.json), and Node.js
# where it is missing and the user is root. Prints their folder, in which read.mjs lies.
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/../tests/node"
die() { echo "node_readers.sh: $*" >&2; exit 1; }
if ! command -v npm >/dev/null; then
  [ "$(id -u)" = 0 ] || die "npm is not installed, and only root can install it"
  command -v apt-get >/dev/null || die "npm is not installed, and there is no apt-get here"
  { apt-get update -qq && DEBIAN_FRONTEND=noninteractive apt-get install -y -qq --no-install-recommends nodejs npm; } \
    >/dev/null || die "npm cannot be installed"
fi
folder=${XDG_CACHE_HOME:-$HOME/.cache}/furrowmap/node-readers-$(cat package-lock.json | sha256sum | cut -c 1-16)
mkdir -p "$folder"
exec 9>"$folder/lock"
flock 9
cp package.json package-lock.json read.mjs "$folder"
if [ ! -e "$folder/complete" ]; then
  (cd "$folder" && npm ci --omit=optional --ignore-scripts --no-audit --no-fund >/dev/null 2>"$folder/log") ||
    die "the readers cannot be installed: $(tail -n 1 "$folder/log")"
  touch "$folder/complete"
fi
echo "$folder"
