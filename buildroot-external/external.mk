# SPDX-License-Identifier: GPL-2.0-or-later
# Gathers the rooms that lie beside this tree: package/, board/, tools/.

DDXVIDEO_TOP = $(BR2_EXTERNAL_DDXVIDEO_PATH)/..

# The users of a package's programs, out of its programs.txt, in the form of Buildroot's users tables; of a package of
# any tree.
ddx-users = $(subst |,$(sep),$(shell awk '/^[a-z.]/ && $$4 ~ /^[0-9]+$$/ { \
	printf "%s %s ddx 900 * - /bin/false -", $$3, $$4; for (i = 5; i <= NF; i++) printf " %s", $$i; printf "|" }' \
	$(wildcard $(patsubst %,%/package/$(1)/programs.txt,$(DDXVIDEO_TOP) $(BR2_EXTERNAL_DIRS))) /dev/null))

# Other trees' files for the root file system; later ones win. Ours are in the configurations of the boards.
BR2_ROOTFS_OVERLAY := $(call qstrip,$(BR2_ROOTFS_OVERLAY)) $(wildcard $(addsuffix /overlay,$(BR2_EXTERNAL_DIRS)))

include $(sort $(wildcard $(DDXVIDEO_TOP)/package/*/*.mk))

# Kconfig drops without a word what depends on something that is off; a camera's driver must not vanish so.
define DDXVIDEO_LINUX_CHECK_CONFIG
	$(DDXVIDEO_TOP)/tools/buildroot_fragments.py $(@D)/.config \
		$(LINUX_KCONFIG_FILE) $(LINUX_KCONFIG_FRAGMENT_FILES)
endef
LINUX_POST_CONFIGURE_HOOKS += DDXVIDEO_LINUX_CHECK_CONFIG

# BusyBox. Buildroot fills up a short configuration with BusyBox's defaults, which are mostly on; this is after that.
define DDXVIDEO_BUSYBOX_CONFIG
	$(DDXVIDEO_TOP)/tools/buildroot_busybox.py $(@D) env $(BUSYBOX_KCONFIG_MAKE)
endef
PACKAGES_BUSYBOX_CONFIG_FIXUPS += $(DDXVIDEO_BUSYBOX_CONFIG)$(sep)

# The boot menu, the same for all boards and both slots, knows the kernel by one name.
define DDXVIDEO_LINUX_INSTALL_KERNEL
	$(INSTALL) -D -m 0644 $(LINUX_IMAGE_PATH) $(TARGET_DIR)/boot/vmlinuz
endef
LINUX_POST_INSTALL_TARGET_HOOKS += DDXVIDEO_LINUX_INSTALL_KERNEL

# GRUB: post-image.sh makes the boot loader out of these; Buildroot's sample menu stays out of the root.
define DDXVIDEO_GRUB2_INSTALL_MODULES
	$(foreach tuple,$(GRUB2_TUPLES-y), \
		mkdir -p $(HOST_DIR)/lib/grub/$(tuple)
		cp $(addprefix $(@D)/build-$(tuple)/grub-core/,*.img *.lst *.mod) \
			$(HOST_DIR)/lib/grub/$(tuple)/
	)
endef
GRUB2_POST_INSTALL_IMAGES_HOOKS += DDXVIDEO_GRUB2_INSTALL_MODULES
GRUB2_CFG_i386-pc = $(BINARIES_DIR)/grub-sample.cfg

# Built with its assembly code, x264 refuses to run on a processor that has MMX only, and is compiled for SSE2.
ifeq ($(BR2_X86_CPU_HAS_SSE2),)
X264_CONF_OPTS += --disable-asm
endif

# libsrtp2 with its own cryptography, whatever else an image has. OpenSSL's licence does not go together with that of x264,
# which is in the same process, and both OpenSSL and NSS take too long to start for each source that is heard.
LIBSRTP_CONF_OPTS += --disable-openssl --disable-nss
