# SPDX-License-Identifier: MIT
"""Flash, RAM, stack and instructions of the images of size.mk. Usage: size.py BUILD [--check | --set-limits]

Runs every image under QEMU with the instruction counter, reads its map and its call graph, writes BUILD/size/size.json and a Markdown table.
--check compares with limits.json beside this file: a line "ok" or "not ok" for each image and goal. --set-limits writes that file.
"""
import concurrent.futures
import json
import pathlib
import re
import statistics
import subprocess
import sys

HERE = pathlib.Path(__file__).parent
LIMITS = HERE / "limits.json"
# What an image measures: node, or another kind for images whose shape begins so. OBJECTS: its own code beside the library's; the last has the roots.
ROOTS = {"node": ["node_start", "node_put", "node_incremental", "node_put_estimate", "node_diffuse"],
         "unscented": ["unscented_start", "unscented_predict", "unscented_put", "unscented_update"],
         "duif": ["duif_start", "duif_predict", "duif_measure", "duif_contribute", "duif_frame", "duif_accept", "duif_iterate", "duif_fuse"],
         "monitor": ["monitor_start", "monitor_watch"]}
ROOTS["weighted"] = [*ROOTS["unscented"], "unscented_update_weighted"]
MARKERS = {"node": ["start", "put", "incremental", "frozen", "put_estimate", "diffuse"], "unscented": ["start", "predict", "put", "update"],
           "duif": [root.removeprefix("duif_") for root in ROOTS["duif"]], "monitor": ["start", "watch"]}
MARKERS["weighted"] = MARKERS["unscented"]
OBJECTS = {"node": ["node"], "unscented": ["unscented", "unscented_node"], "duif": ["duif", "duif_node"], "monitor": ["monitor", "monitor_node"],
           "weighted": ["weighted", "unscented_node"]}
# These call seal and open, which plain frames do not.
SEALS = "mk_frame_|mk_link_|mk_duif_(frame|accept)"
# What a function may call by pointer: models, and, but for those of MODELS_ONLY, the kernels of an update.
MODELS = ["moves", "moves_jacobian", "ranges", "ranges_jacobian"]
MODELS_ONLY = "predict|_stack_f32|filter_stack|_absorb|mk_space_difference|mk_call|mk_linearise|mk_extend"
KERNELS = ["mk_shared_stack_f32", "mk_shared_absorb_f32", "filter_stack", "filter_absorb"]
# What is held, with its name in the messages.
HELD_OF = {}
HELD_OF["unscented"] = {"flash": "flash, bytes", "ram": "RAM, bytes", "stack": "stack by the call graph, bytes", "stack_painted": "stack as painted, bytes",
                        "start": "instructions of start", "put": "instructions of taking a reading",
                        **{f"{name} {call}": f"instructions of {call}, {name}" for name in ("ukf", "ekf", "mpukf-5", "mpukf-30", "iukf")
                           for call in ("predict", "update")}}
HELD_OF["node"] = {"flash": "flash, bytes", "ram": "RAM, bytes", "stack": "stack by the call graph, bytes", "stack_painted": "stack as painted, bytes",
        "step_usual": "instructions of a usual step", "step_max": "instructions of a step at most", "frozen": "instructions of a frozen step", "diffuse": "instructions of diffusion at most",
        "put": "instructions of taking a reading"}
HELD_OF["duif"] = {"flash": "flash, bytes", "ram": "RAM, bytes", "stack": "stack by the call graph, bytes", "stack_painted": "stack as painted, bytes",
                   "step": "instructions of a step", **{name: f"instructions of {name}" for name in MARKERS["duif"]}}
MEMORY = {key: HELD_OF["node"][key] for key in ("flash", "ram", "stack", "stack_painted")}
HELD_OF["monitor"] = {**MEMORY, "start": "instructions of start", "usual": "instructions of a usual epoch", "most": "instructions of an epoch at most"}
WEIGHTED = ("ekf", "rekf-n-usual", "rekf-n", "rekf-t-usual", "rekf-t")
HELD_OF["weighted"] = {**MEMORY, **{f"{name} update": f"instructions of update, {name}" for name in WEIGHTED}}
SECONDS = 60  # an image needs a few


def kind(shape):
    return next((name for name in ROOTS if shape.startswith(name + "-")), "node")


class Failure(Exception):
    pass


def run(command, **options):
    return subprocess.run(command, stdin=subprocess.DEVNULL, capture_output=True, text=True, timeout=SECONDS, check=True, **options).stdout


# --- instructions and painted stack ------------------------------------------------------------------------------------------

def count(build, target, shape, prefix, emulator):
    """Runs the image: counts by marker, in order, and the lines that it wrote."""
    elf = build / "firmware" / target / f"size-{shape}.elf"
    out = build / "size" / f"{target}-{shape}.counts"
    address = {fields[2]: fields[0] for fields in (line.split() for line in run([prefix + "nm", elf]).splitlines()) if len(fields) == 3}
    plugin = [f"{build}/size/count.so", f"out={out}", f"end=0x{address['size_end']}"]
    # A marker that the linker dropped, as there is nothing to mark, stands at an address that no instruction has.
    markers = ["nothing", "loop_100", "loop_300"] + MARKERS[kind(shape)]
    plugin += [f"begin=0x{address.get('size_begin_' + name, '1')}" for name in markers]
    done = subprocess.run(emulator.split() + ["-plugin", ",".join(plugin), "-kernel", elf], stdin=subprocess.DEVNULL, capture_output=True, text=True,
                          timeout=SECONDS)
    text = done.stdout + done.stderr
    if done.returncode:
        raise Failure(f"{target} {shape}: the image ended with status {done.returncode}: {text[-300:]}")
    counts = {name: [] for name in markers}
    for line in out.read_text().splitlines():
        marker, value = line.split()
        counts[markers[int(marker)]].append(int(value))
    cost = counts["nothing"][0]  # of the markers themselves
    return {name: [value - cost for value in values] for name, values in counts.items()}, [line.split() for line in text.splitlines()]


def instructions(build, plan):
    counts, lines = count(build, *plan)
    turn = counts["loop_300"][0] - counts["loop_100"][0]
    if turn != 400:
        raise Failure(f"{plan[0]}: 200 turns of a loop of two instructions were counted as {turn}")
    painted = {line[1]: int(line[2]) for line in lines if line[:1] == ["stack"]}
    common = {"ram": next(int(line[1]) for line in lines if line[:1] == ["ram"]), "stack_painted": max(painted.values()), "stack_painted_of": painted,
              "start": max(counts["start"])}
    return common | {"node": of_node, "unscented": of_filters, "weighted": of_filters, "duif": of_duif, "monitor": of_monitor}[kind(plan[1])](counts, lines)


def of_filters(counts, lines):
    """The most that a call takes, for each filter."""
    row, first = {"put": max(counts["put"])}, 0
    for name, steps in (line[1:3] for line in lines if line[:1] == ["filter"]):
        for call in ("predict", "update"):
            row[f"{name} {call}"] = max(counts[call][first:first + int(steps)])
        first += int(steps)
    return row


def of_monitor(counts, lines):
    """An epoch without faults in the middle, and the most of all."""
    usual = next(int(line[1]) for line in lines if line[:1] == ["usual"])
    return {"usual": statistics.median_low(counts["watch"][:usual]), "usual_max": max(counts["watch"][:usual]), "most": max(counts["watch"])}


def of_duif(counts, lines):
    """The most that each call takes, and all calls of a step on average."""
    steps = next(int(line[1]) for line in lines if line[:1] == ["steps"])
    calls = {name: counts[name] for name in MARKERS["duif"] if name != "start"}
    return {"step": round(sum(map(sum, calls.values())) / steps)} | {name: max(values) for name, values in calls.items()}


def of_node(counts, lines):
    steps, by_scenario, good = list(counts["incremental"]), {}, []
    for name, full, failed in (line[1:] for line in lines if line[:1] == ["scenario"]):
        mine, steps = steps[:int(full)], steps[int(full):]
        by_scenario.setdefault(name, []).extend(mine)
        good += mine[:len(mine) - int(failed)]
    return {
        "put": max(counts["put"]), "step_min": min(good), "step_max": max(counts["incremental"]), "step_usual": statistics.median_low(by_scenario["all"]),
        "step_of": {name: [min(values), max(values)] for name, values in by_scenario.items()},
        "frozen": max(counts["frozen"]), "put_estimate": max(counts["put_estimate"], default=None), "diffuse": max(counts["diffuse"]),
    }


# --- flash -------------------------------------------------------------------------------------------------------------------

def flash(build, target, shape):
    """Text and constants of the node's object and the library's, which is all the linker kept for the functions of ROOTS; the rest: arithmetic of the
    compiler's library in the image."""
    own = f"/size/{OBJECTS[kind(shape)][-1]}.o"
    text = (build / "firmware" / target / f"size-{shape}.map").read_text().split("Linker script and memory map", 1)[1]
    of = {}
    arithmetic, drawn_in = 0, set()
    for name, size, file in re.findall(r"^ (\.(?:text|s?rodata)\S*)\s+0x[0-9a-f]+\s+0x([0-9a-f]+) (\S+)$", text, re.M):
        size = int(size, 16)
        if file.endswith(("/meshkal.o", own)):
            of[name] = of.get(name, 0) + size
        elif size and ".a(" in file:
            drawn_in.add(file.split("(")[1].rstrip(")"))
            arithmetic += size if "libgcc.a" in file or "libm.a" in file else 0
    return {"flash": sum(of.values()), "flash_of": {name: size for name, size in sorted(of.items(), key=lambda item: -item[1]) if size},
            "arithmetic": arithmetic, "drawn_in": sorted(drawn_in)}


# --- stack by the call graph -------------------------------------------------------------------------------------------------

def assembled(elf, prefix):
    """Frame and callees of every function in the image by its machine code: for those of the compiler's library, which has no call graph."""
    functions, current, calls = {}, [0, set()], set()
    for line in run([prefix + "objdump", "-d", "--no-show-raw-insn", elf]).splitlines():
        head = re.match(r"[0-9a-f]+ <(.+)>:$", line)
        if head:
            calls = set()
            current = functions[head[1]] = [0, calls]
            continue
        fields = line.split("\t")
        if len(fields) < 2 or not functions:
            continue
        name, rest = fields[1].strip(), fields[2] if len(fields) > 2 else ""
        if name in ("push", "stmdb", "vpush") and ("{" in rest):
            registers = 0
            for part in re.search(r"\{(.*)\}", rest)[1].split(","):
                low, _, high = part.strip().partition("-")
                width = 2 if low.startswith("d") else 1
                registers += width * (int(high[1:]) - int(low[1:]) + 1 if high else 1)
            current[0] += 4 * registers
        elif name in ("sub", "sub.w", "subw") and re.match(r"sp, (sp, )?#\d+", rest):
            current[0] += int(re.search(r"#(\d+)", rest)[1])
        elif name in ("addi", "add", "c.addi16sp") and re.match(r"sp,(sp,)?-\d+", rest):
            current[0] += int(re.search(r"-(\d+)", rest)[1])
        elif "<" in rest and name in ("bl", "b", "b.w", "b.n", "beq.w", "jal", "j", "call", "jalr"):
            callee = re.search(r"<([^+>]+)", rest)[1]
            if "+" not in rest:
                calls.add(callee)
    return functions


def stack(build, target, shape, prefix):
    """Worst depth below each function of ROOTS, its own frame included."""
    directory = build / "firmware" / target
    frames, calls = {}, {}
    for graph in [directory / "meshkal.ci"] + [directory / f"size-{shape}/tests/firmware/size/{name}.ci" for name in OBJECTS[kind(shape)]]:
        text = graph.read_text()
        for title, label in re.findall(r'^node: \{ title: "(.*?)" label: "(.*?)"', text, re.M):
            size = re.search(r"\\n(\d+) bytes \((.*?)\)", label)
            if size:
                if size[2] != "static":
                    raise Failure(f"{target} {shape}: the frame of {title} is {size[2]}")
                frames[title] = int(size[1])
        for source, callee in re.findall(r'^edge: \{ sourcename: "(.*?)" targetname: "(.*?)"', text, re.M):
            calls.setdefault(source, set()).add(callee)
    short = {title.split(":")[-1].split(".")[0]: title for title in frames}  # titles of static functions begin with their file
    machine = assembled(directory / f"size-{shape}.elf", prefix)

    def depth(function, above=()):
        if function == "__indirect_call":
            if kind(shape) == "duif" and re.search(SEALS, above[-1]):
                return 0
            if kind(shape) in ("node", "monitor"):
                raise Failure(f"{target} {shape}: {above[-1]} calls by pointer")
            only_models = any(re.search(MODELS_ONLY, f) for f in above)
            return max(depth(short[name], above) for name in MODELS + KERNELS * (not only_models) if name in short)
        if function in above:
            raise Failure(f"{target} {shape}: {function} is recursive")
        if function in frames:
            frame, callees = frames[function], calls.get(function, ())
        elif function in machine:
            frame, callees = machine[function]
            callees = [c for c in callees if c in machine and c != function and c not in above]
        else:
            return 0  # an instruction in this place, or not called from the five
        return frame + max((depth(callee, above + (function,)) for callee in callees), default=0)

    of = {root: depth(root) for root in ROOTS[kind(shape)]}
    return {"stack": max(of.values()), "stack_of": of}


# --- tables and limits -------------------------------------------------------------------------------------------------------

def measure(build, plan):
    target, shape, prefix, emulator = plan
    row = {"target": target, "shape": shape}
    row.update(flash(build, target, shape))
    row.update(stack(build, target, shape, prefix))
    row.update(instructions(build, plan))
    if row["stack_painted"] > row["stack"]:
        raise Failure(f"{target} {shape}: {row['stack_painted']} bytes of stack were used, the call graph knows of {row['stack']}")
    return row


def thousands(value):
    return "" if value is None else f"{value:,}".replace(",", " ")


def table(rows):
    yield "| target | n, m, slots | kernels | flash | arithmetic | RAM | stack: graph, painted | step: usual | least | most | ratio | frozen | diffusion |"
    yield "|---|---|---|---|---|---|---|---|---|---|---|---|---|"
    for row in (row for row in rows if kind(row["shape"]) == "node"):
        n, m, slots, real, kernels = row["shape"].split("-")
        cells = [row["target"], f"{n}, {m}, {slots}", f"{'float32' if real == 'f32' else 'float64'} {kernels}", thousands(row["flash"]),
                 thousands(row["arithmetic"]), thousands(row["ram"]), f"{thousands(row['stack'])}, {thousands(row['stack_painted'])}",
                 thousands(row["step_usual"]), thousands(row["step_min"]), thousands(row["step_max"]), f"{row['step_max'] / row['step_min']:.2f}",
                 thousands(row["frozen"]), thousands(row["diffuse"])]
        yield "| " + " | ".join(cells) + " |"


    yield "\n| target | n, m, slots | kernels | flash | RAM | stack: graph, painted | predict, EKF, others | update: EKF | UKF | MPUKF, N = 5 | N = 30 | IUKF |"
    yield "|---|---|---|---|---|---|---|---|---|---|---|---|"
    for row in (row for row in rows if kind(row["shape"]) == "unscented"):
        n, m, slots, real, kernels = row["shape"].split("-")[1:]
        cells = [row["target"], f"{n}, {m}, {slots}", kernels, thousands(row["flash"]), thousands(row["ram"]),
                 f"{thousands(row['stack'])}, {thousands(row['stack_painted'])}", f"{thousands(row['ekf predict'])}, {thousands(row['ukf predict'])}",
                 *(thousands(row[f"{name} update"]) for name in ("ekf", "ukf", "mpukf-5", "mpukf-30", "iukf"))]
        yield "| " + " | ".join(cells) + " |"


    yield "\n| target | n, m, slots | flash | RAM | stack: graph, painted | step, L = 10 | predict | contribute | frame | accept | iterate | fuse |"
    yield "|---|---|---|---|---|---|---|---|---|---|---|---|"
    for row in (row for row in rows if kind(row["shape"]) == "duif"):
        cells = [row["target"], ", ".join(row["shape"].split("-")[1:4]), thousands(row["flash"]), thousands(row["ram"]),
                 f"{thousands(row['stack'])}, {thousands(row['stack_painted'])}",
                 *(thousands(row[name]) for name in ("step", "predict", "contribute", "frame", "accept", "iterate", "fuse"))]
        yield "| " + " | ".join(cells) + " |"


    yield "\n| target | monitor: places, m, window | flash | RAM | stack: graph, painted | watch: usual | with window turned | most |"
    yield "|---|---|---|---|---|---|---|---|"
    for row in (row for row in rows if kind(row["shape"]) == "monitor"):
        cells = [row["target"], ", ".join(row["shape"].split("-")[1:4]), thousands(row["flash"]), thousands(row["ram"]),
                 f"{thousands(row['stack'])}, {thousands(row['stack_painted'])}", *(thousands(row[name]) for name in ("usual", "usual_max", "most"))]
        yield "| " + " | ".join(cells) + " |"


    yield "\n| target | n, m, slots | flash | RAM | stack: graph, painted | predict | update: EKF | REKF-N: usual | most | REKF-t: usual | most |"
    yield "|---|---|---|---|---|---|---|---|---|---|---|"
    for row in (row for row in rows if kind(row["shape"]) == "weighted"):
        cells = [row["target"], ", ".join(row["shape"].split("-")[1:4]), thousands(row["flash"]), thousands(row["ram"]),
                 f"{thousands(row['stack'])}, {thousands(row['stack_painted'])}", thousands(row["ekf predict"]),
                 *(thousands(row[f"{name} update"]) for name in WEIGHTED)]
        yield "| " + " | ".join(cells) + " |"


def check(rows):
    limits = json.loads(LIMITS.read_text())
    margin, wrong = limits["margin"], 0
    for row in rows:
        name, grown = f"{row['target']} {row['shape']}", []
        limit = limits["images"].get(name)
        if limit is None:
            grown.append("has no limits: make size-limits")
        for key, what in HELD_OF[kind(row["shape"])].items() if limit else ():
            if row[key] > limit[key] * (1 + margin):
                grown.append(f"{what}: {limit[key]} has grown to {row[key]}, {100 * (row[key] / limit[key] - 1):.1f} %, allowed {100 * margin:g} %")
                if key == "flash":
                    before = limit["flash_of"]
                    more = {part: size - before.get(part, 0) for part, size in row["flash_of"].items() if size > before.get(part, 0)}
                    grown[-1] += " (" + ", ".join(f"{part} +{size}" for part, size in sorted(more.items(), key=lambda item: -item[1])[:4]) + ")"
                elif key.startswith("stack"):
                    before = limit[key + "_of"]
                    grown[-1] += " (" + ", ".join(f"{part} {before[part]} -> {size}" for part, size in row[key + "_of"].items() if size > before[part]) + ")"
        more = sorted(set(row["drawn_in"]) - set(limit["drawn_in"])) if limit else []
        if more:
            grown.append(f"draws in {', '.join(more[:6])} of the C library")
        wrong += bool(grown)
        print(f"not ok: size of {name}: {'; '.join(grown)}" if grown else f"ok: size of {name}")
    for goal in limits["goals"]:
        row = next(row for row in rows if goal["image"] == f"{row['target']} {row['shape']}")
        value = row[goal["value"]]
        good = value <= goal["most"]
        wrong += not good
        print(f"{'ok' if good else 'not ok'}: goal on {goal['image']}: {goal['name']} {value}, at most {goal['most']}")
    return wrong


def set_limits(rows):
    old = json.loads(LIMITS.read_text()) if LIMITS.exists() else {"margin": 0.03, "goals": []}
    kept = ["drawn_in", "flash_of", "stack_of", "stack_painted_of"]
    old["images"] = {f"{row['target']} {row['shape']}": {key: row[key] for key in list(HELD_OF[kind(row["shape"])]) + kept} for row in rows}
    LIMITS.write_text(json.dumps(old, indent=1) + "\n")
    print(f"size: limits written to {LIMITS}")


def main(arguments):
    build = pathlib.Path(arguments[0])
    plans = [line.split("|") for line in (build / "size" / "plan").read_text().splitlines()]
    try:
        with concurrent.futures.ThreadPoolExecutor(2) as pool:
            rows = list(pool.map(lambda plan: measure(build, plan), plans))
    except (Failure, subprocess.SubprocessError, OSError, KeyError) as failure:
        print(f"not ok: size: {failure}")
        return 1
    (build / "size" / "size.json").write_text(json.dumps(rows, indent=1) + "\n")
    if "--set-limits" in arguments:
        set_limits(rows)
    elif "--check" in arguments:
        return check(rows) > 0
    else:
        print("\n".join(table(rows)))
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
