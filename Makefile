# SPDX-License-Identifier: MIT
# `make run` and `make test` are the two commands. Each brings what it needs (tools/setup.sh); `make help` lists the others.

# What to run: a scene, and further arguments for tandem.
SCENE ?= rolling_disk
ARGS  ?=
# Flags of the two builds, on top of those for the machine at hand. Both allow gfortran to inline public procedures of
# position-independent code (-fno-semantic-interposition), and to compile kernels once for each constant size (-fipa-cp-clone,
# part of -O3). The fast build compiles in a third of the time. The optimised one also inlines across files, by link-time
# optimisation; its objects suit any linker.
ARCH  ?= -march=native
FAST      = --flag "$(shell cat tools/flags/fast) $(ARCH)"
OPTIMISED = --flag "$(shell cat tools/flags/optimised) $(ARCH)"
FPM     = .venv/bin/fpm
# fpm may keep modules that a changed one has made stale; a build that fails is then repeated from the start.
BUILD_FAST      = $(FPM) run tandem $(FAST) --runner install -- build/tandem
BUILD_OPTIMISED = $(FPM) run tandem $(OPTIMISED) --runner install -- -D build/optimised/tandem
# Where `make install` puts the program and the libraries; DESTDIR stands before it, for packagers.
PREFIX  ?= /usr/local
DESTDIR ?=
# Parts, all if empty: of the tests (tools/verify.py --list), or of what is installed (library program command-line, mpi by name).
PARTS ?=
INSTALLED = $(or $(PARTS),library program command-line)
REMOVED = $(or $(PARTS),library program command-line mpi)
INSTALL_NEEDS = $(filter mpi,$(INSTALLED)) \
	$(if $(filter program,$(INSTALLED)),optimised,$(if $(filter command-line,$(INSTALLED)),setup))

export ARCH
# The systems are small: threads inside BLAS cost more than they bring.
export OPENBLAS_NUM_THREADS ?= 1
# A git hook exports these; fpm's calls of git would follow them into another repository.
unexport GIT_DIR GIT_WORK_TREE GIT_INDEX_FILE GIT_PREFIX GIT_COMMON_DIR GIT_OBJECT_DIRECTORY

.PHONY: help setup build optimised mpi run test test-all sanitize coverage docs python plots bench bench-count install uninstall wheel dist clean
.DEFAULT_GOAL := help

run: build ## run a scene, e.g. make run SCENE=articulated_vehicle ARGS='--set time.end=5'
	@build/tandem run $(SCENE) --force $(ARGS)
	@echo 'Next: make python && build/tandem view $(notdir $(basename $(SCENE))).h5    (animation in a browser); make help lists the other targets'

test: ## run all tests; the last line is "N passed, N failed" (PARTS='lint python' selects parts)
	@tools/setup.sh test
	@tools/setup.sh docs
	@python3 tools/verify.py $(PARTS)

test-all: ## make test and slow tests: suites of the optimised build, animations in a browser, OpenMPI
	@tools/setup.sh test
	@tools/setup.sh docs
	@python3 tools/verify.py --all

sanitize: ## detect memory errors and undefined behaviour by sanitizers and valgrind (slow)
	@tools/setup.sh test
	@tools/sanitize.py

coverage: ## line coverage of src/ by the tests; uncovered lines are in build/coverage/coverage.txt
	@tools/setup.sh test
	@tools/setup.sh coverage
	@tools/coverage.sh

plots: optimised ## repeat the measurements of README and doc/, and update figures and tables (some minutes)
	@tools/setup.sh plot
	@tools/plots.sh

bench: optimised ## compare tandem with other solvers, for doc/performance.md (some minutes; CORE=1 for another core)
	@tools/setup.sh plot
	@tools/setup.sh bench
	@tools/bench.sh

bench-count: setup ## compare instruction counts of short runs with recorded ones (requires valgrind)
	@tools/setup.sh bench
	@tools/bench.sh count

build: setup ## build the program in a minute or two: build/tandem
	@$(BUILD_FAST) || { echo 'build: once more, from the start'; rm -rf build/gfortran_*; $(BUILD_FAST); }

optimised: setup ## build the program with link-time optimisation, for measurements and installation: build/optimised/tandem
	@$(BUILD_OPTIMISED) || { echo 'build: once more, from the start'; rm -rf build/gfortran_*; $(BUILD_OPTIMISED); }

mpi: build ## build build/tandem-mpi for sweeps over several machines, with Debian's OpenMPI (doc/sweep.md)
	@tools/setup.sh mpi
	@cd mpi && ../$(FPM) run tandem-mpi --flag "$$(cat ../tools/flags/optimised) $(ARCH)" --runner install -- \
		../build/tandem-mpi

setup: ## install missing requirements: compiler, libraries, fpm and dependencies
	@tools/setup.sh

install: $(INSTALL_NEEDS) ## install program, scenes and libraries below PREFIX (/usr/local); PARTS=library requires no fpm
	@python3 tools/library.py install --prefix "$(PREFIX)" --destdir "$(DESTDIR)" --parts $(INSTALLED)

uninstall: ## remove files of `make install` below PREFIX (PARTS selects parts)
	@python3 tools/library.py uninstall --prefix "$(PREFIX)" --destdir "$(DESTDIR)" --parts $(REMOVED)

wheel: setup ## build dist/*.whl: Python package with library and program, for any x86-64 Linux (doc/installation.md)
	@tools/setup.sh wheel
	@rm -rf build/wheel python/build dist/*.whl
	@TANDEM_PORTABLE=1 .venv/bin/python -m pip wheel --quiet --no-deps --no-build-isolation -w build/wheel ./python
	@PATH=$(CURDIR)/.venv/bin:$(PATH) auditwheel repair -z 9 $(foreach name,libtandem.so.1 libtandem-blas.so.1 libgfortran.so.5 libquadmath.so.0,--exclude $(name)) \
		-w dist build/wheel/*.whl

dist: setup ## build dist/tandem-VERSION-linux-x86_64.tar.xz: relocatable archive of program, libraries, scenes and documents
	@tools/setup.sh wheel
	@rm -f dist/*.tar.xz
	@python3 tools/library.py archive

python: build ## install the Python package into a separate environment, build/python; also for tandem plot and view
	@tools/python.sh

docs: ## build the reference of the library with the pages of doc/: build/docs/index.html
	@tools/setup.sh docs
	@python3 tools/docs.py

clean: ## remove all build products
	@rm -rf build

help: ## print this list
	@sed -n 's/^\([a-z-]*\):.*## /  make \1\t/p' $(MAKEFILE_LIST) | expand -t 14
