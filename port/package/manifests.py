#!/usr/bin/env python3
# SPDX-License-Identifier: MIT
"""Writes what package systems want to know, from one place and with the one version (MK_VERSION). Usage: manifests.py DIRECTORY

    DIRECTORY/zephyr/module.yml            DIRECTORY/platformio/library.json
    DIRECTORY/esp-idf/idf_component.yml    DIRECTORY/arduino/library.properties

`make manifests` writes them to port/, where they are kept; a test writes them elsewhere and compares."""
import json
import pathlib
import re
import sys

ROOT = pathlib.Path(__file__).resolve().parents[2]
SENTENCE = "State estimators for the nodes of a sensor network."
PARAGRAPH = ("Robust distributed Kalman filters of fixed size: no heap, no writable static data, every failure a status, "
             "the same bits on every IEEE target.")
KEYWORDS = ["kalman", "estimation", "sensor-network", "robust", "distributed"]
# Arduino demands an address. The domain never resolves (RFC 6761): put the repository's there before publishing.
URL = "https://meshkal.invalid/"
AUTHOR = "Meshkal contributors"
# Boards with 8-bit AVR are left out: their double is a float, so the 64-bit functions would not be what their names say.
ARCHITECTURES = ["esp32", "mbed_nano", "mbed_portenta", "renesas_portenta", "renesas_uno", "rp2040", "sam", "samd", "stm32"]
# -ffp-contract=off reaches the library by build.flags, and by the script every unit of the project, where unrolled kernels are compiled.
PLATFORMIO_BUILD = {"flags": ["-ffp-contract=off", "-lm"], "extraScript": "contract.py"}


def manifests(version):
    yield "zephyr/module.yml", ("# SPDX-License-Identifier: MIT\n# Written by make manifests.\n"
                                f"# Meshkal {version}. {SENTENCE}\n"
                                "name: meshkal\nbuild:\n  cmake: zephyr\n  kconfig: zephyr/Kconfig\n")
    yield "esp-idf/idf_component.yml", ("# SPDX-License-Identifier: MIT\n# Written by make manifests.\n"
                                        f'version: "{version}"\ndescription: {SENTENCE}\nlicense: MIT\ntags:\n'
                                        + "".join(f"  - {word}\n" for word in KEYWORDS))
    yield "platformio/library.json", json.dumps({
        "name": "meshkal", "version": version, "description": f"{SENTENCE} {PARAGRAPH}", "keywords": KEYWORDS,
        "license": "MIT", "authors": [{"name": AUTHOR}], "headers": "meshkal.h", "frameworks": "*", "platforms": "*",
        "build": PLATFORMIO_BUILD}, indent=2) + "\n"
    yield "arduino/library.properties", "".join(f"{key}={value}\n" for key, value in {
        "name": "Meshkal", "version": version, "author": AUTHOR, "maintainer": AUTHOR, "sentence": SENTENCE, "paragraph": PARAGRAPH,
        "category": "Data Processing", "url": URL, "architectures": ",".join(ARCHITECTURES), "includes": "meshkal.h"}.items())


def main():
    if len(sys.argv) != 2:
        sys.exit(__doc__)
    version = re.search(r'#define MK_VERSION "(.*)"', (ROOT / "include/meshkal/base.h").read_text()).group(1)
    for name, text in manifests(version):
        path = pathlib.Path(sys.argv[1]) / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text)


if __name__ == "__main__":
    main()
