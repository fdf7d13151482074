#!/usr/bin/env bash
# Prints the path of RTKLIB's rnx2rtkp, for the tests. Where there is none and we are root, it is installed from Debian's
# package rtklib.
set -euo pipefail
die() { echo "rtklib.sh: $*" >&2; exit 1; }

print_if_there() {
  if command -v rnx2rtkp; then
    exit 0
  fi
}

print_if_there
[ "$(id -u)" = 0 ] || die "RTKLIB is not installed, and only root can install it (Debian: rtklib)"
command -v apt-get >/dev/null || die "RTKLIB is not installed, and there is no apt-get here"
export DEBIAN_FRONTEND=noninteractive

exec 9>"${TMPDIR:-/tmp}/furrowmap-rtklib.lock"
flock 9
print_if_there
apt-get update -qq || die "apt-get cannot reach Debian's packages"
apt-get install -y -qq --no-install-recommends rtklib >/dev/null || die "Debian's package rtklib could not be installed"
print_if_there
die "rtklib was installed, yet there is no rnx2rtkp in the path"
