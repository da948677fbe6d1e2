################################################################################
#
# ddxcatalog
#
################################################################################

DDXCATALOG_VERSION = $(DDX_VERSION)
DDXCATALOG_SITE = $(BR2_EXTERNAL_DDXVIDEO_PATH)/../package/ddxcatalog
DDXCATALOG_SITE_METHOD = local
DDXCATALOG_LICENSE = GPL-2.0+
DDXCATALOG_LICENSE_FILES = LICENSE
DDXCATALOG_DEPENDENCIES = cyclonedds ddx
DDXCATALOG_USERS = $(call ddx-users,ddxcatalog)

$(eval $(meson-package))
