# make demo   edit the built-in scene and leave pictures in out/demo
# make test   run the tests
# Both start from a fresh clone: they make .venv and install everything first (make setup).
# make check (lint, format, types, documentation) and make bench (targets) are for those who change the code.
# make levels runs the tests with the vectors of older processors: SSE and AVX2 (twice as long as make test).
# make docs builds the documentation as a site in site/, strictly: a broken link fails.
# make fuzz damages 2,000 files of every kind and reads them.
# make sanitize runs the C++ files under ASan, UBSan and TSan; make bench does so too.
# make wheel builds a wheel that holds the compiled kernels, in dist/, and tries each of its levels of vectors.
# make paper SCENES="bear.ply garden.ply" tries the paper's claims on these scenes (10 minutes of processor time each) and
# writes out/paper/claims.md. An interrupted one goes on.

PYTHON ?= python3
BIN := .venv/bin
STAMP := .venv/.installed

# What open3d and pyvista load at run time on Linux; the core of gsedit needs none of them.
LIBRARIES := libusb-1.0-0 libegl1 libgl1 libgl1-mesa-dri libx11-6 libudev1 libidn2-0

# The benchmark scene's points (gsplat's garden.npz); without them make bench leaves its targets out.
GARDEN ?= $(or $(GSEDIT_GARDEN),../shared/data/garden_points.npz)

.PHONY: setup demo test levels check docs bench sanitize fuzz paper wheel

setup: $(STAMP)

$(STAMP): pyproject.toml constraints.txt
	@$(system_packages)
	@$(BIN)/python -m pip --version >/dev/null 2>&1 || $(PYTHON) -m venv --clear .venv
	$(BIN)/python -m pip install --quiet --constraint constraints.txt --editable '.[all,dev,docs]'
	@touch $@

demo: setup
	$(BIN)/python examples/demo.py out/demo
	@echo 'next: source .venv/bin/activate, then gsedit --help (or: $(BIN)/gsedit --help)'

# Up to four files of tests at a time, a thread each: two processes of two threads stall each other.
# (numba, which gsply imports in tests, would set OpenMP's threads to all processors.)
test: setup
	OMP_NUM_THREADS=1 NUMBA_NUM_THREADS=1 $(BIN)/python -m pytest -n auto --maxprocesses 4 --dist loadfile

levels: setup
	for level in default avx2; do ATEN_CPU_CAPABILITY=$$level MKL_ENABLE_INSTRUCTIONS=AVX2 ONEDNN_MAX_CPU_ISA=AVX2 \
		$(MAKE) test || exit 1; done

check: docs
	@echo 'numbers differ between processors: make levels runs the tests as on older ones'
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/basedpyright
	$(BIN)/python tests/docstrings.py gsedit rasterizer cli examples tests

docs: setup
	NO_MKDOCS_2_WARNING=1 $(BIN)/mkdocs build --strict --quiet

bench: setup sanitize
	$(BIN)/gsedit bench targets $(if $(wildcard $(GARDEN)),--points $(GARDEN))

sanitize: setup
	PYTHONPATH=tests:. $(BIN)/python tests/sanitizers.py

fuzz: setup
	PYTHONPATH=tests:. $(BIN)/python tests/fuzzing.py 2000

# The wheel is unpacked, so that the tree's own files are not what is tried.
wheel: setup
	rm -rf dist build
	GSEDIT_KERNELS=-s $(BIN)/python -m pip wheel --quiet --no-deps -w dist .
	$(BIN)/python -m zipfile -e dist/gsedit-*.whl build/wheel
	PYTHONPATH=build/wheel $(BIN)/python tests/wheel_levels.py

paper: setup
	PYTHONPATH=examples $(BIN)/python -m research.painting out/paper $(SCENES)

# Debian and its children: install what is missing if we may, else say how. Never a reason to stop:
# without the libraries only the viewers are missing, and without venv the next line says so itself.
define system_packages
if command -v dpkg-query >/dev/null 2>&1; then \
	missing=''; \
	for package in $(LIBRARIES); do \
		dpkg-query -W -f '$${Status}\n' $$package 2>/dev/null | grep -q 'ok installed' \
			|| missing="$$missing $$package"; \
	done; \
	$(PYTHON) -c 'import ensurepip, venv' 2>/dev/null || missing="$$missing python3-venv"; \
	if [ -n "$$missing" ]; then \
		echo "system packages to install:$$missing"; \
		if [ "$$(id -u)" = 0 ] && command -v apt-get >/dev/null 2>&1 \
			&& apt-get update -qq \
			&& DEBIAN_FRONTEND=noninteractive \
				apt-get install -y -qq --no-install-recommends $$missing >/dev/null; \
		then :; \
		else echo "please run: sudo apt-get update && sudo apt-get install -y$$missing"; \
		fi; \
	fi; \
fi
endef
