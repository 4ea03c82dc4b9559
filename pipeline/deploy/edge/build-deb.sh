#!/bin/sh
# A Debian package of a tower unit: sh pipeline/deploy/edge/build-deb.sh [FOLDER], in a clone.
#
# Needs dpkg-deb, python3 with venv, and the network once. The package holds an environment in
# /opt/pilewatch with everything but Python itself, the unit of an instrument's feed, and an example
# of its settings; it is for the architecture and the Python that it was built with.
set -eu

here=$(cd "$(dirname "$0")" && pwd)
clone=$(cd "$here/../../.." && pwd)
folder=${1:-$clone/dist}
version=$(sed -n 's/^version = "\(.*\)"/\1/p' "$here/pyproject.toml")
python=$(python3 -c 'import sys; print("python3.%d" % sys.version_info[1])')
architecture=$(dpkg --print-architecture)
mkdir -p "$folder"
root=$(mktemp -d)
trap 'rm -rf "$root"' EXIT
chmod 755 "$root"

# The wheel and its requirements, as README.md has them
"$python" -m venv "$root/opt/pilewatch"
pip="$root/opt/pilewatch/bin/pip --quiet --disable-pip-version-check"
$pip wheel --no-deps -w "$root/wheel" "$here"
$pip install --require-hashes --only-binary :all: -r "$here/requirements.txt"
$pip install --no-deps "$root"/wheel/pilewatch_edge-*.whl
$pip uninstall --yes pip setuptools
rm -rf "$root/wheel"
# Scripts begin with the path of their Python: the one on the unit
grep -rlI "$root" "$root/opt/pilewatch/bin" "$root/opt/pilewatch/pyvenv.cfg" |
    xargs sed -i "s|$root||g"
# Compiled here: the unit's service may not write, and what Python writes dpkg does not remove
find "$root" -name __pycache__ -prune -exec rm -rf {} +
"$python" -m compileall -q -s "$root" -p / "$root/opt/pilewatch/lib"

install -D -m 644 "$here/../examples/pilewatch-feed@.service" \
    "$root/lib/systemd/system/pilewatch-feed@.service"
install -D -m 644 "$here/../examples/tower-unit.json5" \
    "$root/usr/share/doc/pilewatch-edge/node.json5"
install -d "$root/usr/bin" "$root/etc/pilewatch" "$root/DEBIAN"
ln -s /opt/pilewatch/bin/pilewatch "$root/usr/bin/pilewatch"

cat > "$root/DEBIAN/control" <<END
Package: pilewatch-edge
Version: $version
Architecture: $architecture
Maintainer: pilewatch
Depends: $python
Installed-Size: $(du -sk "$root" | cut -f1)
Description: publishes a tower's instruments to a pilewatch shore station
 The commands publish and feed, with MQTT and SeedLink. Settings stand in /etc/pilewatch; an instrument is
 started by systemctl enable --now pilewatch-feed@NAME.
END
dpkg-deb --root-owner-group --build "$root" "$folder/pilewatch-edge_${version}_$architecture.deb"
