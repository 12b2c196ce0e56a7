/**
 * json_mesh_name.c: how requests name meshes: by an id, or the hash of a file; where they are, or moved by a transform.
 */
#include <cjson/cJSON.h>
#include <stdio.h>
#include <string.h>

#include "base/json.h"
#include "job_kinds_internal.h"
#include "json_request.h"

const char *qm_json_hash_of_name(const char *name)
{
    size_t prefix = strlen(QM_JOB_HASH_PREFIX);
    return strncmp(name, QM_JOB_HASH_PREFIX, prefix) == 0 ? name + prefix : NULL;
}

bool qm_json_is_hash(const char *text)
{
    return strlen(text) == QM_HASH_SIZE - 1 && strspn(text, "0123456789abcdef") == QM_HASH_SIZE - 1;
}

bool qm_json_read_mesh_name(const char *text, char out[QM_JOB_MESH_SIZE])
{
    static const char letters[] = "abcdefghijklmnopqrstuvwxyzABCDEFGHIJKLMNOPQRSTUVWXYZ0123456789_.-";
    const char *hash = text ? qm_json_hash_of_name(text) : NULL;
    if (!text || !text[0] || (hash && !qm_json_is_hash(hash))) return false;
    if (!hash && (strlen(text) >= QM_ID_SIZE || text[strspn(text, letters)])) return false;
    strcpy(out, text);
    return true;
}

/** Reads {"mesh": name, "transform": [16 numbers]}. */
static bool read_posed(const cJSON *object, char name[QM_JOB_MESH_SIZE], qm_job_pose *pose,
                       qm_json_location *at)
{
    const cJSON *mesh = cJSON_GetObjectItemCaseSensitive(object, "mesh");
    const cJSON *transform = cJSON_GetObjectItemCaseSensitive(object, "transform");
    if (cJSON_GetArraySize(object) != (mesh != NULL) + (transform != NULL)) return false;
    at->member = "mesh";
    snprintf(at->detail, sizeof at->detail, QM_JOB_NAMES_MESH);
    if (!qm_json_read_mesh_name(cJSON_GetStringValue(mesh), name)) return false;
    at->member = "transform";
    if (!qm_json_read_transform(transform, pose->transform, at)) return false;
    pose->is_given = !qm_transform_is_identity(pose->transform);
    at->member = NULL;
    return true;
}

bool qm_json_read_mesh(const cJSON *value, char name[QM_JOB_MESH_SIZE], qm_job_pose *pose,
                       qm_json_location *at)
{
    return cJSON_IsObject(value) ? read_posed(value, name, pose, at)
                                 : qm_json_read_mesh_name(cJSON_GetStringValue(value), name);
}

void qm_json_add_mesh(qm_text *out, const char *name, const qm_job_pose *pose)
{
    if (!pose->is_given) {
        qm_json_add_quoted(out, name);
        return;
    }
    qm_text_add_string(out, "{");
    qm_json_add_string(out, "mesh", name);
    qm_json_add_numbers(out, "transform", pose->transform, QM_TRANSFORM_SIZE);
    qm_text_add_string(out, "}");
}
