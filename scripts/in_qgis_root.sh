#!/usr/bin/env bash
# Runs a command inside the folder that qgis_root.sh built:   in_qgis_root.sh COMMAND [ARGUMENT]...
# The current folder and the folder for temporary files are there under their own paths; HOME is empty, and temporary files of its own are forgotten;
# of the environment only CI, TERM, TZ, DISPLAY, proxies, PIP_*, QGIS_* and FURROWMAP_* go in. Mounts and processes end with the command.
set -euo pipefail
root=${XDG_CACHE_HOME:-$HOME/.cache}/furrowmap/qgis-root
[ -f "$root/etc/qgis-root" ] || { echo "in_qgis_root.sh: no QGIS in $root; run qgis_root.sh first" >&2; exit 125; }
if [ "${1-}" != --inside ]; then
  exec unshare --mount --propagation private --pid --fork --kill-child bash "${BASH_SOURCE[0]}" --inside "$@"
fi
shift

mount -t proc proc "$root/proc"
mount -t tmpfs tmpfs "$root/root"
mount -t tmpfs tmpfs "$root/run"
mkdir -m 700 "$root/run/user"
mkdir -m 1777 "$root/run/tmp"  # goes with the mount: Qt leaves files behind
for folder in /dev "$(realpath "${TMPDIR:-/tmp}")" "$(pwd -P)"; do
  mkdir -p "$root$folder"
  mount --rbind "$folder" "$root$folder"
done
# For pip inside: name resolution, certificates, this machine's pip settings and the local folders that these name.
for file in /etc/resolv.conf /etc/hosts /etc/pip.conf /etc/ssl/certs/ca-certificates.crt; do
  [ -f "$file" ] || continue
  mkdir -p "$root${file%/*}"
  [ -e "$root$file" ] && [ ! -L "$root$file" ] || { rm -f "$root$file"; : >"$root$file"; }
  mount --bind "$(realpath "$file")" "$root$file"
done
{ cat /etc/pip.conf 2>/dev/null || true; env | grep '^PIP_' || true; } | grep -oE '(file://)?/[^ ,;"'"'"']+' |
  sed -e 's,^file://,,' -e 's,/$,,' -e 's,/simple$,,' | sort -u | while IFS= read -r folder; do
  [ -d "$folder" ] || continue
  mkdir -p "$root$folder"
  mount --rbind "$folder" "$root$folder"
done
kept=()
while IFS= read -r name; do kept+=("$name=${!name}"); done < <(compgen -e | grep -xE 'CI|TERM|TZ|DISPLAY|QGIS_.*|PIP_.*|FURROWMAP_.*|.*_proxy|.*_PROXY' || true)
exec chroot "$root" /usr/bin/env -i -C "$(pwd -P)" PATH=/usr/local/bin:/usr/sbin:/usr/bin:/sbin:/bin HOME=/root \
  LANG=C.UTF-8 QT_QPA_PLATFORM=offscreen XDG_RUNTIME_DIR=/run/user TMPDIR=/run/tmp \
  NUMBA_CACHE_DIR=/opt/furrowmap-kernels "${kept[@]}" "$@"
