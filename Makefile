# SPDX-License-Identifier: GPL-2.0-or-later
# The front door. Does nothing itself: everything is in tools/.
#
#   CLIP=my.y4m    the clip for `make run`
#   ACCEL=tcg|kvm  QEMU's acceleration, instead of finding out what works
#   BOARD=miniitx  which image, instead of the development image: run, test, image, flash
#   FIRMWARE=uefi  which of the board's firmwares, bios or uefi: run, test
#   T=...          which tests, as pytest's -k expression
#   ROUNDS=, CASES=  for `make bench`: docs/bench.md
#   DEV=           and more for `make flash`: docs/flash.md

PYTHON = /usr/bin/python3 -B

RUN_BENCH = $(if $(ROUNDS),-rounds '$(ROUNDS)') $(if $(CASES),-cases '$(CASES)')

.PHONY: help setup setup-build build run test image crash bench legal sbom lint flash desktop clean distclean

help:            ## this list
	@sed -n 's/^\([a-z]*\):.*## \(.*\)/  make \1\t\2/p' Makefile | expand -t 20
setup:           ## install what building and testing need (Debian packages)
	@tools/setup test
setup-build:
	@tools/setup
build: setup-build  ## build the programs and the development image, output/dev/disk.img
	@$(PYTHON) tools/build.py
run: setup-build ## a clip through the appliance in QEMU, frame by frame; output/report.json
	@$(PYTHON) tools/run.py "$(CLIP)"
test: setup      ## all tests
	@$(PYTHON) tools/test.py $(if $(T),'$(T)')
image:           ## build the product with Buildroot: BOARD=miniitx|pc104, output/<board>/disk.img; an hour the first time
	@tools/setup image
	@$(PYTHON) tools/buildroot.py image "$(BOARD)"
crash: setup     ## kill parties of the store 10,000 times; docs/crash.md
	@$(PYTHON) tools/crash.py
bench:           ## the store beside other ways to pass frames: ROUNDS=, CASES=, see docs/bench.md
	@tools/setup bench
	@$(PYTHON) tools/bench.py $(RUN_BENCH)
# Only words of the command line count: a HOSTNAME or DEV that happens to be in the environment must not.
FLASH_WORDS = BOARD DEV IMAGE YES FILE SSH_KEY HOSTNAME CONSOLE
TYPED = $(foreach word,$(FLASH_WORDS),$(if $(findstring command,$(origin $(word))),$(word)='$($(word))'))
flash: setup-build  ## write an image to a disk and compare: BOARD=dev DEV=/dev/sdX, see docs/flash.md
	@$(PYTHON) tools/flash.py $(TYPED)
legal:           ## licences and sources of all that is in an image: BOARD=, see docs/licences.md
	@tools/setup image
	@$(PYTHON) tools/legal.py "$(BOARD)"
sbom:            ## list of all that is in an image (CycloneDX): BOARD=
	@tools/setup image
	@$(PYTHON) tools/sbom.py "$(BOARD)"
lint: setup      ## check scripts, tools and sources without running them
	@$(PYTHON) tools/lint.py
desktop: setup-build  ## install the store, its library and Python module: PREFIX=/usr/local, DESTDIR=
	@$(PYTHON) tools/desktop.py "$(or $(PREFIX),/usr/local)" "$(DESTDIR)"
clean:           ## remove what was built, keep what was downloaded
	@tools/clean
distclean:       ## remove all output
	@tools/clean all
