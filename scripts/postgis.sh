#!/usr/bin/env bash
# Prints the folder of a PostgreSQL's programs that has the PostGIS extension, for the tests.
# Where there is none and we are root, it is installed from Debian's packages. No server is started by this script, and
# the cluster that Debian's package would make and start by itself is not made.
set -euo pipefail
die() { echo "postgis.sh: $*" >&2; exit 1; }

print_if_there() {
  local control version
  for control in /usr/share/postgresql/*/extension/postgis.control; do
    version=${control#/usr/share/postgresql/}
    version=${version%%/*}
    if [ -f "$control" ] && [ -x "/usr/lib/postgresql/$version/bin/initdb" ]; then
      echo "/usr/lib/postgresql/$version/bin"
      exit 0
    fi
  done
}

print_if_there
[ "$(id -u)" = 0 ] || die "PostGIS is not installed, and only root can install it (Debian: postgresql-postgis)"
command -v apt-get >/dev/null || die "PostGIS is not installed, and there is no apt-get here"
export DEBIAN_FRONTEND=noninteractive
install() { apt-get install -y -qq --no-install-recommends "$@" >/dev/null; }

exec 9>"${TMPDIR:-/tmp}/furrowmap-postgis.lock"
flock 9
print_if_there
apt-get update -qq || die "apt-get cannot reach Debian's packages"
cluster=()
if [ ! -e /etc/postgresql-common/createcluster.conf ]; then
  mkdir -p /etc/postgresql-common
  echo "create_main_cluster = false" >/etc/postgresql-common/createcluster.conf
  cluster=(-o Dpkg::Options::=--force-confold)
fi
install "${cluster[@]}" postgresql-postgis || die "Debian's package postgresql-postgis could not be installed"
print_if_there
die "postgresql-postgis was installed, yet there is no PostGIS in /usr/share/postgresql"
