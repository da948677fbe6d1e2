################################################################################
#
# ddxcatalog
#
################################################################################

DDXCATALOG_VERSION = $(DDX_VERSION)
DDXCATALOG_SITE = $(BR2_EXTERNAL_DDXVIDEO_PATH)/../package/ddxcatalog
DDXCATALOG_SITE_METHOD = local
DDXCATALOG_LICENSE = GPL-2.0+
DDXCATALOG_LICENSE_FILES = LICENSES/GPL-2.0.txt
DDXCATALOG_POST_RSYNC_HOOKS += DDXVIDEO_COPY_LICENSES
DDXCATALOG_DEPENDENCIES = cyclonedds ddx
DDXCATALOG_USERS = $(call ddx-users,ddxcatalog)
DDXCATALOG_POST_INSTALL_TARGET_HOOKS += DDXVIDEO_INSTALL_INIT_SCRIPTS

$(eval $(meson-package))
