/* SPDX-License-Identifier: GPL-2.0-or-later */
/* Types made at run time, since items may have any type. */

#include "internal.h"
#include "name.h"

static const dds_dynamic_type_kind_t kinds[] = {
    [DESCRIPTION_INT8] = DDS_DYNAMIC_INT8,      [DESCRIPTION_UINT8] = DDS_DYNAMIC_UINT8,
    [DESCRIPTION_INT16] = DDS_DYNAMIC_INT16,    [DESCRIPTION_UINT16] = DDS_DYNAMIC_UINT16,
    [DESCRIPTION_INT32] = DDS_DYNAMIC_INT32,    [DESCRIPTION_UINT32] = DDS_DYNAMIC_UINT32,
    [DESCRIPTION_INT64] = DDS_DYNAMIC_INT64,    [DESCRIPTION_UINT64] = DDS_DYNAMIC_UINT64,
    [DESCRIPTION_FLOAT] = DDS_DYNAMIC_FLOAT32,  [DESCRIPTION_DOUBLE] = DDS_DYNAMIC_FLOAT64,
    [DESCRIPTION_STRING] = DDS_DYNAMIC_STRING8,
};

static dds_dynamic_type_t make(struct network *network, const struct description *description,
                               const struct description_message *message);

/* A type that is part of another one is owned by that one. */
static dds_dynamic_type_spec_t spec_of(struct network *network, const struct description *description,
                                       const struct description_field *field) {
    dds_dynamic_type_spec_t spec;

    if (field->kind == DESCRIPTION_NESTED)
        spec = DDS_DYNAMIC_TYPE_SPEC(make(network, description, description_find(description, field->type)));
    else if (field->kind == DESCRIPTION_STRING)
        spec = DDS_DYNAMIC_TYPE_SPEC(dds_dynamic_type_create(
            network->participant, (dds_dynamic_type_descriptor_t){.kind = DDS_DYNAMIC_STRING8}));
    else
        spec = DDS_DYNAMIC_TYPE_SPEC_PRIM(kinds[field->kind]);
    if (field->sequence)
        return DDS_DYNAMIC_TYPE_SPEC(dds_dynamic_type_create(
            network->participant,
            (dds_dynamic_type_descriptor_t){.kind = DDS_DYNAMIC_SEQUENCE, .name = "sequence", .element_type = spec}));
    if (!field->count)
        return spec;
    return DDS_DYNAMIC_TYPE_SPEC(
        dds_dynamic_type_create(network->participant, (dds_dynamic_type_descriptor_t){.kind = DDS_DYNAMIC_ARRAY,
                                                                                      .name = "array",
                                                                                      .element_type = spec,
                                                                                      .num_bounds = 1,
                                                                                      .bounds = &field->count}));
}

static dds_dynamic_type_t make(struct network *network, const struct description *description,
                               const struct description_message *message) {
    char name[NAME_TYPE];

    name_type(message->type, name);
    dds_dynamic_type_t type = dds_dynamic_type_create(
        network->participant, (dds_dynamic_type_descriptor_t){.kind = DDS_DYNAMIC_STRUCTURE, .name = name});
    dds_dynamic_type_set_extensibility(&type, DDS_DYNAMIC_TYPE_EXT_FINAL);
    for (unsigned i = 0; i < message->count; i++)
        dds_dynamic_type_add_member(&type, DDS_DYNAMIC_MEMBER_(spec_of(network, description, &message->fields[i]),
                                                               message->fields[i].name, DDS_DYNAMIC_MEMBER_ID_AUTO,
                                                               DDS_DYNAMIC_MEMBER_INDEX_END));
    return type;
}

dds_entity_t network_topic(struct network *network, const char *name, const struct description *description,
                           unsigned keys) {
    dds_dynamic_type_t type = make(network, description, description->messages);
    dds_topic_descriptor_t *descriptor = NULL;
    dds_typeinfo_t *info = NULL;
    dds_entity_t topic;

    for (unsigned i = 0; i < keys; i++)
        dds_dynamic_member_set_key(&type, i, true);
    dds_return_t result = type.ret ? type.ret : dds_dynamic_type_register(&type, &info);
    if (!result)
        result = dds_create_topic_descriptor(DDS_FIND_SCOPE_LOCAL_DOMAIN, network->participant, info, 0, &descriptor);
    topic = result ? result : dds_create_topic(network->participant, descriptor, name, NULL, NULL);
    if (descriptor)
        dds_delete_topic_descriptor(descriptor);
    if (info)
        dds_free_typeinfo(info);
    dds_dynamic_type_unref(&type);
    return topic < 0 ? network_error(topic) : topic;
}
