#!/usr/bin/env bash
# Builds, once, the scripts of the page of `furrowmap share` (web/, versions in web/package-lock.json) with npm into
# exporters/share/bundle, where the package takes them from.
#   web_bundle.sh             fails, saying why, where npm is missing or its registry cannot be reached
#   web_bundle.sh --install   installs Node.js and npm first, where they are missing and the user is root
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."
die() { echo "web_bundle.sh: $*" >&2; exit 1; }
out=exporters/share/bundle
stamp=$(cat web/package-lock.json web/*.js scripts/web_bundle.sh | sha256sum | cut -c 1-16)
kept=${XDG_CACHE_HOME:-$HOME/.cache}/furrowmap/web-bundle-$stamp
mkdir -p "${kept%/*}"
exec 9>"${kept%/*}/web-bundle-lock"
flock 9
[ "$(cat "$out/stamp" 2>/dev/null)" = "$stamp" ] && exit 0
into_package() {
  rm -rf "$out"
  cp -r "$kept" "$out"
}
if [ -e "$kept/stamp" ]; then into_package; exit 0; fi
if ! command -v npm >/dev/null; then
  [ "${1:-}" = --install ] || die "npm is not installed"
  [ "$(id -u)" = 0 ] || die "npm is not installed, and only root can install it"
  command -v apt-get >/dev/null || die "npm is not installed, and there is no apt-get here"
  { apt-get update -qq && DEBIAN_FRONTEND=noninteractive apt-get install -y -qq --no-install-recommends nodejs npm; } \
    >/dev/null || die "npm cannot be installed"
fi
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
cp web/package.json web/package-lock.json web/*.js "$work"
(cd "$work" && npm ci --ignore-scripts --no-audit --no-fund --fetch-retries=1 >/dev/null 2>log) ||
  die "the libraries cannot be installed: $(tail -n 1 "$work/log")"
bundle() { # NAME [OPTION...]: one script that any browser of the last years reads, from disk too
  local name=$1
  shift
  (cd "$work" && node_modules/.bin/esbuild "$name.js" --bundle --minify --format=iife --target=es2020 \
    --legal-comments=none --log-level=warning --metafile="$name.json" --outfile="out/$name.js" "$@")
}
bundle map
bundle cloud --global-name=furrowmapCloud
# The licences of the packages of which something is in the scripts.
(cd "$work" && node --input-type=module -e '
import { existsSync, readdirSync, readFileSync } from "node:fs";
const names = new Set();
for (const file of ["map.json", "cloud.json"])
  for (const output of Object.values(JSON.parse(readFileSync(file)).outputs))
    for (const [path, { bytesInOutput }] of Object.entries(output.inputs)) {
      const found = /^node_modules\/((?:@[^/]+\/)?[^/]+)\//.exec(path);
      if (found && bytesInOutput) names.add(found[1]);
    }
for (const name of [...names].sort()) {
  const folder = `node_modules/${name}`;
  const { version, license } = JSON.parse(readFileSync(`${folder}/package.json`));
  const text = readdirSync(folder).find((file) => /^licen[cs]e/i.test(file));
  console.log(`${name} ${version} (${license})\n\n${text ? readFileSync(`${folder}/${text}`, "utf8") : ""}\n`);
}') > "$work/out/licences.txt"
echo "$stamp" > "$work/out/stamp"
rm -rf "$kept"
mv "$work/out" "$kept"
into_package
