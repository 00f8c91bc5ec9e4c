#!/bin/sh
# Builds the original Deep RTS, headless, with our driver: build.sh CHECKOUT EXECUTABLE
#
# CHECKOUT is the reader's own clone of github.com/cair/deep-rts; nothing is written into it, and
# the executable reads the maps from it. Needs g++, xtensor and nlohmann-json; on Debian:
# apt-get install g++ libxtensor-dev nlohmann-json3-dev
#
# OpenCV, Blend2D, spdlog, effolkronium/random and the resource compiler are replaced by stubs/.
# One line is changed, without which the 31x31 maps abort: a tile whose depleted form is not on
# the map becomes itself.
set -eu

if [ $# -ne 2 ]; then
    echo "usage: $0 CHECKOUT EXECUTABLE" >&2
    exit 2
fi
here=$(cd "$(dirname "$0")" && pwd)
checkout=$(cd "$1" && pwd)
executable=$2
if [ ! -f "$checkout/src/Tilemap.cpp" ]; then
    echo "$checkout is not a checkout of github.com/cair/deep-rts" >&2
    exit 1
fi

objects=$(mktemp -d)
trap 'rm -rf "$objects"' EXIT
tilemap=$objects/Tilemap.cpp
sed 's/= *\(.*\)\.at(depletedTypeId)/= \1.count(depletedTypeId) ? \1.at(depletedTypeId) : newTileData/' \
    "$checkout/src/Tilemap.cpp" >"$tilemap"
if cmp -s "$checkout/src/Tilemap.cpp" "$tilemap"; then
    echo "src/Tilemap.cpp is not as expected: the depleted tile could not be changed" >&2
    exit 1
fi

# The flags of its own release build; warnings are not ours to fix.
for source in "$here/driver.cpp" "$tilemap" "$checkout"/src/state/*.cpp \
    "$checkout/src/util/Pathfinder.cpp" "$checkout/src/gui/BaseGUI.cpp" \
    "$checkout"/src/Game.cpp "$checkout"/src/Map.cpp "$checkout"/src/Player.cpp \
    "$checkout"/src/ResourceLoader.cpp "$checkout"/src/Tile.cpp "$checkout"/src/Unit.cpp \
    "$checkout"/src/UnitManager.cpp; do
    echo "compiling $(basename "$source")"
    "${CXX:-g++}" -std=c++17 -Ofast -ffast-math -DNDEBUG -w \
        "-DASSETS_OF=\"$checkout/DeepRTS/python\"" \
        -I "$here/stubs" -I "$checkout/include/DeepRTS" -I "$checkout/include" \
        -c "$source" -o "$objects/$(basename "$source" .cpp).o"
done
"${CXX:-g++}" "$objects"/*.o -o "$executable"
