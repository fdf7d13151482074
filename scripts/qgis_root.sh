#!/usr/bin/env bash
# Builds, once, a folder with a small Debian 13 in which QGIS 3.40 runs: the tests' QGIS.
# (Debian 12's own, 3.22, opens no COPC.) Needs root, apt-get and 3 GB; takes about two minutes.
# Prints the folder. A folder that is complete carries etc/qgis-root, and is left as it is.
set -euo pipefail
root=${XDG_CACHE_HOME:-$HOME/.cache}/furrowmap/qgis-root
marker=etc/qgis-root
suite=trixie
packages=(
  qgis python3-qgis qgis-providers              # desktop, PyQGIS, the COPC provider
  libqt5sql5-sqlite libqt5svg5 qt5-image-formats-plugins
  fonts-open-sans fonts-dejavu-core             # QGIS looks for Open Sans on the net where it is missing
  xvfb xauth xdotool openbox scrot libgl1-mesa-dri  # a screen, for pictures of the desktop
  ca-certificates gdal-bin procps poppler-utils python3-venv python3-pip python3-pytest python3-setuptools
)
die() { echo "qgis_root.sh: $*" >&2; exit 1; }
exit_if_complete() { if [ -f "$root/$marker" ]; then echo "$root"; exit 0; fi; }

exit_if_complete
[ "$(id -u)" = 0 ] || die "only root can build a Debian root folder"
command -v apt-get >/dev/null || die "there is no apt-get here"
mkdir -p "${root%/*}"
exec 9>"$root.lock"
flock 9
exit_if_complete
[ ! -e "$root" ] || die "$root is there but incomplete; remove it"
[ "$(df --output=avail -k "${root%/*}" | tail -n 1)" -gt 3500000 ] || die "less than 3.5 GB free in ${root%/*}"

if ! command -v mmdebstrap >/dev/null; then
  { apt-get update -qq && apt-get install -y -qq --no-install-recommends mmdebstrap; } >/dev/null || die "no mmdebstrap"
fi
# The mirror, proxy and certificates that this machine's own apt uses.
codename=$(. /etc/os-release && echo "$VERSION_CODENAME")
mirror=$(apt-get indextargets --format '$(CODENAME) $(REPO_URI)' 'Created-By: Packages' |
  awk -v codename="$codename" '$1 == codename { print $2; exit }')
[ -n "$mirror" ] || die "this machine's apt names no Debian mirror"
rm -rf --one-file-system "$root".building.*       # left by a build that was killed
building=$(mktemp -d "$root.building.XXXXXX")
settings=$(mktemp)
trap 'rm -rf --one-file-system "$building" "$settings"' EXIT
trap 'exit 130' INT TERM HUP
apt-config dump | grep -E '^Acquire::(http|https|Retries|Check-)[^ ]* "[^"]+";$' >"$settings" || true
chmod 755 "$building"

echo "building Debian $suite with QGIS in $root (log: $root.log)" >&2
no_docs=(--dpkgopt=path-exclude=/usr/share/{doc,man,locale}/'*')
unshare --mount --propagation private --pid --fork --kill-child --mount-proc \
  mmdebstrap --mode=root --variant=apt --format=directory --aptopt="$settings" "${no_docs[@]}" \
    --keyring=/usr/share/keyrings/debian-archive-keyring.gpg \
    --include="$(IFS=,; echo "${packages[*]}")" \
    --customize-hook='rm -f "$1"/etc/apt/apt.conf.d/99mmdebstrap' \
    "$suite" "$building" "$mirror" >"$root.log" 2>&1 9>&- ||
  { tail -n 20 "$root.log" >&2; die "the build failed; the whole log is in $root.log"; }
chroot "$building" dpkg-query -W -f '${Package} ${Version}\n' qgis python3 gdal-bin libproj25 >"$settings"
install -m 644 "$settings" "$building/$marker"
mv -T "$building" "$root"
echo "$root"
