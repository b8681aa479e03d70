# Tasks. `just check` is what CI runs. Tools come from .venv when there is one.

# as many processes as there are cores; each begins with neighbours, which share what they slice
workers := "-n logical --dist worksteal"

export PATH := justfile_directory() / ".venv/bin" + (if os_family() == "windows" { ";" } else { ":" }) + env("PATH")

# everything that must hold before a change lands
check: format lint types contracts test twin budget

# what takes longer: every case, many examples from one seed, the second engine over everything, the oldest libraries
thorough SEED="1": format lint types contracts budget (test "-m ''" "--hypothesis-profile thorough" "--hypothesis-seed" SEED) (twin-all "--hypothesis-seed" SEED) lowest

# formatting, without changing anything
format:
    ruff format --check .

lint:
    ruff check .

types:
    mypy

# the rooms import only from rooms below them
contracts:
    lint-imports

test *ARGS:
    python -m pytest {{workers}} {{ARGS}}

# tests that need no terminals, links or signals of Unix: what CI runs on macOS and Windows
portable *ARGS:
    python -m pytest {{workers}} tests/adhesion tests/gcode tests/geometry tests/infill tests/macros tests/mesh_io tests/motion tests/planning tests/profile tests/stream tests/surface tests/travels --ignore tests/mesh_io/test_damage.py --ignore tests/mesh_io/test_gltf.py --ignore tests/mesh_io/test_stl.py --ignore tests/profile/test_profile.py --ignore tests/profile/test_toml_text.py --ignore tests/stream/test_stream_ports.py {{ARGS}}

# the properties once more with examples that no run has tried; what fails is kept in .hypothesis and tried again first
random *ARGS:
    python -m pytest {{workers}} -m hypothesis --hypothesis-profile thorough {{ARGS}}

# what the engine decides once more, with the shapely engine and without the compiled kernel: operations, regions, walls, solid infill, whole slices; cases that name this engine are skipped, because `test` has run them
twin:
    PRINTER_SLICER_GEOMETRY=planar PRINTER_SLICER_KERNEL=off python -m pytest {{workers}} -k "not planar" tests/geometry tests/test_pipeline.py tests/test_regions.py tests/test_perimeters.py tests/infill/test_exact_filling.py

# what slicing costs: fails if sample parts cost more calls, modules, memory or much more CPU time than recorded
budget *ARGS:
    python -m benchmarks.budget {{ARGS}}

# the geometry and everything that stands on it once more, with the shapely engine and without the compiled kernel: every case, many examples
twin-all *ARGS:
    PRINTER_SLICER_GEOMETRY=planar PRINTER_SLICER_KERNEL=off python -m pytest {{workers}} -m "" --hypothesis-profile thorough {{ARGS}} tests/geometry tests/test_pipeline.py tests/test_regions.py tests/test_perimeters.py tests/infill tests/adhesion tests/torture

# what stands on libraries once more, with the oldest versions of them that pyproject.toml allows
lowest:
    uv venv -q --allow-existing --python "$(command -v python)" build/lowest
    uv pip install -q --python build/lowest/bin/python --resolution lowest-direct -e '.[dev]'
    build/lowest/bin/python -m pytest tests/mesh_io tests/geometry tests/profile tests/test_drawing.py

# put formatting and simple lint right
fix:
    ruff format .
    ruff check --fix .

cover:
    python -m pytest {{workers}} --cov --cov-report=term

# whole processes, side by side with PrusaSlicer if it is installed
bench *ARGS:
    python -m benchmarks.compare {{ARGS}}

# wheel and sdist in fresh environments of every Python that is found, with and without a C++ compiler
install *ARGS:
    python benchmarks/installing.py {{ARGS}}

# the fragments of changelog.d become the section of this version in CHANGELOG.md; --draft only shows it
changelog *ARGS:
    python -m benchmarks.changelog {{ARGS}}

# the site, in build/site; warnings are errors
docs:
    sphinx-build -W --keep-going -q -b html docs build/site

# what is made from the settings: docs/reference/settings.md and the schemas for editors
settings:
    printer-slicer profiles settings --markdown > docs/reference/settings.md
    printer-slicer profiles schema -o profiles/schema

# outputs of commands in docs/results.md
readme:
    python -m benchmarks.readme

# parts and pictures of docs/gallery.md
gallery *NAMES:
    python -m benchmarks.gallery {{NAMES}}

# sample parts and the picture of the layer plan in docs/results.md
parts:
    python sample_parts/make.py
    printer-slicer plan sample_parts/case_study.stl --printer marlin_220_06 --quality case_study --picture docs/case_study.svg --quiet
