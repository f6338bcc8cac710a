#!/usr/bin/env bash
# Packs a built program with its licences, manual pages and shell completions, and writes the SHA-256 checksum beside the archive. The workflow
# `release.yml` runs it; `cargo binstall` expects these names ([package.metadata.binstall] in Cargo.toml).
#
#   packaging/archive.sh PROGRAM TARGET FOLDER    writes FOLDER/depthloom-VERSION-TARGET.tar.gz and .tar.gz.sha256, prints the path of the archive
#
# The program must run on this machine: it writes the manual pages and completions itself.
set -euo pipefail
if [ $# != 3 ]; then
    echo "usage: $0 PROGRAM TARGET FOLDER" >&2
    exit 2
fi
program=$1 target=$2 folder=$3
root=$(cd "$(dirname "$0")/.." && pwd)
version=$("$program" --version | sed -nE '1s/^depthloom ([^ ]+).*/\1/p')
name=depthloom-$version-$target
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT

mkdir -p "$folder" "$work/$name/completions"
install -m 755 "$program" "$work/$name/depthloom"
install -m 644 "$root"/LICENSE-* "$root/README.md" "$root/CHANGELOG.md" "$work/$name/"
# The pages have the name of the file that is called.
"$work/$name/depthloom" man --out "$work/$name/man" >"$work/man.log"
for shell in bash elvish fish powershell zsh; do
    "$work/$name/depthloom" completions "$shell" >"$work/$name/completions/depthloom.$shell"
done
# GNU tar writes the same bytes for the same program; other tars lack these options.
same=()
case $(tar --version) in
    *'GNU tar'*) same=(--sort=name --owner=0 --group=0 --numeric-owner --mtime=@0) ;;
esac
tar -C "$work" ${same[@]+"${same[@]}"} -cf - "$name" | gzip -n -9 >"$folder/$name.tar.gz"
cd "$folder"
if command -v sha256sum >/dev/null; then
    sha256sum "$name.tar.gz" >"$name.tar.gz.sha256"
else
    shasum -a 256 "$name.tar.gz" >"$name.tar.gz.sha256"
fi
echo "$PWD/$name.tar.gz"
