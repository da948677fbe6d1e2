################################################################################
#
# cyclonedds
#
################################################################################

# 11.0.1 and later commits: the source of the Rust package eclipse-cyclonedds-sys 0.0.4, which the desk's build takes.
CYCLONEDDS_VERSION = 57d553b16391e03cbcdde8becc7b1b41ac1589b4
CYCLONEDDS_SITE = $(call github,eclipse-cyclonedds,cyclonedds,$(CYCLONEDDS_VERSION))
CYCLONEDDS_LICENSE = EPL-2.0 or BSD-3-Clause
CYCLONEDDS_LICENSE_FILES = LICENSE
CYCLONEDDS_INSTALL_STAGING = YES
# A static library: one program has it.
CYCLONEDDS_INSTALL_TARGET = NO
# Also read by tools/parts/image/cyclonedds.py.
CYCLONEDDS_CONF_OPTS = \
	-DBUILD_DDSPERF=OFF \
	-DBUILD_IDLC=OFF \
	-DBUILD_SHARED_LIBS=OFF \
	-DENABLE_ICEORYX2=OFF \
	-DENABLE_ICEORYX=OFF \
	-DENABLE_LTO=OFF \
	-DENABLE_QOS_PROVIDER=OFF \
	-DENABLE_SECURITY=OFF \
	-DENABLE_SSL=OFF
# Target "all" does not link without the parts that are left out.
CYCLONEDDS_BUILD_OPTS = --target ddsc

# ddxcatalog needs the patches.
CYCLONEDDS_POST_RSYNC_HOOKS += DDXVIDEO_PATCH_OVERRIDDEN

$(eval $(cmake-package))
