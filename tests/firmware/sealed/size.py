# SPDX-License-Identifier: MIT
"""What sealing costs on every target: flash, stack, instructions for 40 bytes of text under a header of 20.
Usage: size.py BUILD [--check]

Runs the images of sealed.mk under QEMU with the instruction counter of tests/firmware/size/count.c and writes a Markdown
table. --check compares with LIMITS: a line "ok" or "not ok" for each target.
"""
import pathlib
import re
import subprocess
import sys

# Flash, stack and instructions of the costlier of seal and open, as measured; allowed is MARGIN more.
LIMITS = {"m0": (2961, 684, 16455), "m4f": (2653, 524, 8293), "m7": (2657, 524, 8292), "m33": (2653, 524, 8292),
          "rv32imac": (3475, 468, 11264), "rv32imafc": (3421, 468, 11264)}
MARGIN = 0.03
MARKERS = ["nothing", "seal", "open", "forged"]


def run(command):
    done = subprocess.run(command, stdin=subprocess.DEVNULL, capture_output=True, text=True, timeout=60)
    if done.returncode:
        sys.exit(f"sealed_size: {' '.join(map(str, command))}: status {done.returncode}: {(done.stdout + done.stderr)[-300:]}")
    return done.stdout + done.stderr


def flash(image):
    """Bytes of Monocypher with the seal on it, and of the 64-bit multiplication where the compiler's library has it."""
    kept = image.with_suffix(".map").read_text().split("Linker script and memory map", 1)[1]
    sections = re.findall(r"^ (\.(?:text|s?rodata)\S*)\s+0x[0-9a-f]+\s+0x([0-9a-f]+) (\S+)$", kept, re.M)
    own = sum(int(size, 16) for _, size, file in sections if file.endswith(("/monocypher.o", "/aead_monocypher.o")))
    multiplication = sum(int(size, 16) for _, size, file in sections if re.search(r"libgcc\.a\((_(ael?)?muldi3|_aeabi_lmul)\.o\)", file))
    return own, multiplication


def instructions(build, image, prefix, emulator):
    lines = (line.split() for line in run([prefix + "nm", image]).splitlines())
    symbols = {fields[2]: fields[0] for fields in lines if len(fields) == 3}
    out = build / "firmware" / "sealed" / "counts"
    plugin = [f"{build}/size/count.so", f"out={out}", f"end=0x{symbols['sealed_end']}"]
    plugin += [f"begin=0x{symbols['sealed_begin_' + name]}" for name in MARKERS]
    arguments = f",arg=sealed,arg={build}/firmware/sealed/sealed.bin"
    text = run((emulator + arguments).split() + ["-plugin", ",".join(plugin), "-kernel", image])
    counts = dict(line.split() for line in out.read_text().splitlines())
    counts = {name: int(counts[str(k)]) - int(counts["0"]) for k, name in enumerate(MARKERS)}
    return counts, [int(word) for word in re.search(r"^stack (\d+) (\d+)$", text, re.M).groups()]


def check(target, measured):
    grown = [f"{what}: {limit} has grown to {value}" for what, limit, value in
             zip(("flash, bytes", "stack, bytes", "instructions"), LIMITS[target], measured) if value > limit * (1 + MARGIN)]
    print(f"not ok: sealing on {target}: {'; '.join(grown)}, allowed {100 * MARGIN:g} %" if grown else f"ok: sealing on {target}")


def main():
    build, checks = pathlib.Path(sys.argv[1]), "--check" in sys.argv
    if not checks:
        print("| target | flash | 64-bit multiplication | stack: seal, open | instructions: seal | open | refuse |")
        print("|---|---|---|---|---|---|---|")
    for line in (build / "firmware" / "targets").read_text().splitlines():
        target, emulator, prefix, _ = line.split("|")
        image = build / "firmware" / target / "sealed-f32.elf"
        own, multiplication = flash(image)
        counts, stack = instructions(build, image, prefix, emulator)
        if checks:
            check(target, (own, max(stack), max(counts.values())))
        else:
            cells = [target, own, multiplication or "", f"{stack[0]}, {stack[1]}", counts["seal"], counts["open"], counts["forged"]]
            print("| " + " | ".join(map(str, cells)) + " |")


if __name__ == "__main__":
    main()
