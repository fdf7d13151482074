#!/usr/bin/env bash
# Finds Debian's Chromium for the tests of report.html, and installs it where it is missing and the user is root.
# Prints its path.
set -euo pipefail
die() { echo "chromium.sh: $*" >&2; exit 1; }
if ! command -v chromium >/dev/null; then
  [ "$(id -u)" = 0 ] || die "chromium is not installed, and only root can install it"
  command -v apt-get >/dev/null || die "chromium is not installed, and there is no apt-get here"
  { apt-get update -qq && DEBIAN_FRONTEND=noninteractive apt-get install -y -qq --no-install-recommends chromium; } \
    >/dev/null || die "chromium cannot be installed"
fi
command -v chromium
