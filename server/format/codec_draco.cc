// The one C++ file: takes Draco's objects apart into the arrays of codec_draco.h.
#include "codec_draco.h"

#include <algorithm>
#include <cmath>
#include <memory>
#include <new>
#include <vector>

// Draco's headers are not clean under our warnings.
#pragma GCC diagnostic push
#pragma GCC diagnostic ignored "-Wshadow"
#pragma GCC diagnostic ignored "-Wconversion"
#pragma GCC diagnostic ignored "-Wsign-conversion"
#pragma GCC diagnostic ignored "-Wunused-parameter"
#include <draco/attributes/attribute_quantization_transform.h>
#include <draco/compression/decode.h>
#include <draco/compression/encode.h>
#include <draco/core/quantization_utils.h>
#pragma GCC diagnostic pop

namespace
{

struct Geometry {
    std::unique_ptr<draco::PointCloud> cloud;
    const draco::Mesh *mesh = nullptr; // the same object, if it is one
};

bool decode_geometry(draco::DecoderBuffer *buffer, Geometry *geometry)
{
    const auto type = draco::Decoder::GetEncodedGeometryType(buffer);
    if (!type.ok()) return false;
    draco::Decoder decoder;
    decoder.SetSkipAttributeTransform(draco::GeometryAttribute::POSITION);
    if (type.value() == draco::TRIANGULAR_MESH) {
        auto decoded = decoder.DecodeMeshFromBuffer(buffer);
        if (!decoded.ok()) return false;
        auto mesh = std::move(decoded).value();
        geometry->mesh = mesh.get();
        geometry->cloud = std::move(mesh);
    } else {
        auto decoded = decoder.DecodePointCloudFromBuffer(buffer);
        if (!decoded.ok()) return false;
        geometry->cloud = std::move(decoded).value();
    }
    return geometry->cloud != nullptr;
}

// True if every value of the attribute lies in its buffer, without gaps, as so many bytes. The file decides
// about all of these, so nothing is read before.
bool is_packed(const draco::PointAttribute &attribute, size_t value_size)
{
    return attribute.byte_offset() == 0 && attribute.byte_stride() == static_cast<int64_t>(value_size) &&
           attribute.buffer() && attribute.buffer()->data_size() / value_size >= attribute.size();
}

// The attribute by which Draco's own tools mark the edges that cut polygons.
const draco::PointAttribute *find_added_edges(const Geometry &geometry)
{
    if (!geometry.mesh || !geometry.cloud->GetMetadata()) return nullptr;
    const int id = geometry.cloud->GetAttributeIdByMetadataEntry("name", "added_edges");
    if (id < 0 || id >= geometry.cloud->num_attributes()) return nullptr;
    const draco::PointAttribute *attribute = geometry.cloud->attribute(id);
    const bool fits = attribute->attribute_type() == draco::GeometryAttribute::GENERIC &&
                      attribute->num_components() == 1 && attribute->data_type() == draco::DT_UINT8 &&
                      is_packed(*attribute, 1);
    return fits ? attribute : nullptr;
}

bool read_quantization(const draco::PointAttribute &positions,
                       draco::AttributeQuantizationTransform *transform, qm_draco_facts *facts)
{
    const draco::AttributeTransformData *data = positions.GetAttributeTransformData();
    if (!data || data->transform_type() == draco::ATTRIBUTE_INVALID_TRANSFORM) return true;
    if (data->transform_type() != draco::ATTRIBUTE_QUANTIZATION_TRANSFORM ||
        !transform->InitFromAttribute(positions) || transform->min_values().size() != 3 ||
        transform->quantization_bits() < 1 || transform->quantization_bits() > 30)
        return false;
    facts->quantization_bits = transform->quantization_bits();
    facts->range = transform->range();
    for (const float low : transform->min_values())
        facts->magnitude = std::fmax(facts->magnitude, std::fabs(double{low}) + facts->range);
    return true;
}

template <typename Number> void copy_values(const draco::PointAttribute &positions, double *out)
{
    for (uint32_t i = 0; i < positions.size(); ++i, out += 3) {
        Number value[3];
        positions.GetValue(draco::AttributeValueIndex(i), value);
        std::copy(value, value + 3, out);
    }
}

bool copy_plain_positions(const draco::PointAttribute &positions, double *out)
{
    if (positions.data_type() == draco::DT_FLOAT32 && is_packed(positions, 3 * sizeof(float)))
        copy_values<float>(positions, out);
    else if (positions.data_type() == draco::DT_FLOAT64 && is_packed(positions, 3 * sizeof(double)))
        copy_values<double>(positions, out);
    else if (positions.data_type() == draco::DT_INT32 && is_packed(positions, 3 * sizeof(int32_t)))
        copy_values<int32_t>(positions, out);
    else
        return false;
    return true;
}

bool copy_quantized_positions(const draco::PointAttribute &positions,
                              const draco::AttributeQuantizationTransform &transform, double *out)
{
    const bool is_integer =
        positions.data_type() == draco::DT_INT32 || positions.data_type() == draco::DT_UINT32;
    if (!is_integer || !is_packed(positions, 3 * sizeof(int32_t))) return false;
    // In single precision like the library's own step, so that all tools see the same coordinates.
    const float step = transform.range() / static_cast<float>((1u << transform.quantization_bits()) - 1);
    for (uint32_t i = 0; i < positions.size(); ++i, out += 3) {
        int32_t steps[3];
        positions.GetValue(draco::AttributeValueIndex(i), steps);
        for (int axis = 0; axis < 3; ++axis)
            out[axis] = double{static_cast<float>(steps[axis]) * step + transform.min_value(axis)};
    }
    return true;
}

bool has_value(const draco::PointAttribute &attribute, draco::PointIndex point)
{
    return (attribute.is_mapping_identity() || point.value() < attribute.indices_map_size()) &&
           attribute.mapped_index(point).value() < attribute.size();
}

bool copy_triangles(const Geometry &geometry, const draco::PointAttribute &positions,
                    const draco::PointAttribute *added, const qm_draco_arrays &arrays)
{
    for (uint32_t t = 0; t < geometry.mesh->num_faces(); ++t) {
        const draco::Mesh::Face &face = geometry.mesh->face(draco::FaceIndex(t));
        for (uint32_t c = 0; c < 3; ++c) {
            const size_t place = 3 * size_t{t} + c;
            if (!has_value(positions, face[c])) return false;
            arrays.triangles[place] = positions.mapped_index(face[c]).value();
            if (!added) continue;
            if (!has_value(*added, face[c])) return false;
            added->GetValue(added->mapped_index(face[c]), arrays.added + place);
        }
    }
    return true;
}

qm_draco_outcome take_apart(const Geometry &geometry, qm_draco_prepare *prepare, void *user)
{
    const draco::PointAttribute *positions =
        geometry.cloud->GetNamedAttribute(draco::GeometryAttribute::POSITION);
    if (!positions) return QM_DRACO_MALFORMED;
    if (positions->num_components() != 3) return QM_DRACO_UNSUPPORTED;
    const draco::PointAttribute *added = find_added_edges(geometry);

    qm_draco_facts facts = {};
    draco::AttributeQuantizationTransform transform;
    facts.vertex_count = positions->size();
    facts.triangle_count = geometry.mesh ? geometry.mesh->num_faces() : 0;
    facts.has_added_edges = added != nullptr;
    facts.has_split_points =
        geometry.mesh && positions->is_mapping_identity() && geometry.cloud->num_attributes() > 1;
    if (!read_quantization(*positions, &transform, &facts)) return QM_DRACO_MALFORMED;

    qm_draco_arrays arrays = {};
    if (!prepare(user, &facts, &arrays)) return QM_DRACO_STOPPED;
    const bool copied = facts.quantization_bits == 0
                            ? copy_plain_positions(*positions, arrays.positions)
                            : copy_quantized_positions(*positions, transform, arrays.positions);
    if (!copied) return QM_DRACO_UNSUPPORTED;
    if (geometry.mesh && !copy_triangles(geometry, *positions, added, arrays)) return QM_DRACO_MALFORMED;
    return QM_DRACO_DONE;
}

// Fills an attribute whose values are rows of the input, one for each point unless points are mapped later.
draco::PointAttribute *add_attribute(draco::PointCloud *cloud, draco::GeometryAttribute::Type type,
                                     int8_t components, draco::DataType data_type, bool is_mapped,
                                     const void *values, size_t count)
{
    draco::GeometryAttribute attribute;
    const int64_t width = components * draco::DataTypeLength(data_type);
    attribute.Init(type, nullptr, components, data_type, false, width, 0);
    const int id = cloud->AddAttribute(attribute, !is_mapped, static_cast<uint32_t>(count));
    draco::PointAttribute *added = cloud->attribute(id);
    added->buffer()->Write(0, values, count * static_cast<size_t>(width));
    return added;
}

// A point of the library is a vertex with a mark of added edges: vertex v without it is point v, and those
// that some corner needs with it come behind. Returns the points that stand at the corners.
std::vector<uint32_t> number_points(const qm_draco_input &input, std::vector<uint32_t> *vertex_of_point)
{
    constexpr uint32_t none = UINT32_MAX;
    std::vector<uint32_t> marked(input.vertex_count, none), points(3 * input.triangle_count);
    for (uint32_t v = 0; v < input.vertex_count; ++v)
        vertex_of_point->push_back(v);
    for (size_t i = 0; i < points.size(); ++i) {
        const uint32_t vertex = input.triangles[i];
        if (input.added[i] && marked[vertex] == none) {
            marked[vertex] = static_cast<uint32_t>(vertex_of_point->size());
            vertex_of_point->push_back(vertex);
        }
        points[i] = input.added[i] ? marked[vertex] : vertex;
    }
    return points;
}

void set_faces(draco::Mesh *mesh, const uint32_t *points, size_t count)
{
    mesh->SetNumFaces(count);
    for (uint32_t t = 0; t < count; ++t) {
        draco::Mesh::Face face;
        for (uint32_t c = 0; c < 3; ++c)
            face[c] = draco::PointIndex(points[3 * size_t{t} + c]);
        mesh->SetFace(draco::FaceIndex(t), face);
    }
}

void fill_cloud(const qm_draco_input &input, draco::PointCloud *cloud)
{
    cloud->set_num_points(static_cast<uint32_t>(input.vertex_count));
    add_attribute(cloud, draco::GeometryAttribute::POSITION, 3, draco::DT_FLOAT32, false, input.positions,
                  input.vertex_count);
}

void fill_marked_mesh(const qm_draco_input &input, draco::Mesh *mesh)
{
    static const uint8_t values[2] = {0, 1};
    std::vector<uint32_t> vertex_of_point;
    const std::vector<uint32_t> points = number_points(input, &vertex_of_point);
    mesh->set_num_points(static_cast<uint32_t>(vertex_of_point.size()));
    draco::PointAttribute *positions =
        add_attribute(mesh, draco::GeometryAttribute::POSITION, 3, draco::DT_FLOAT32, true, input.positions,
                      input.vertex_count);
    draco::PointAttribute *marks =
        add_attribute(mesh, draco::GeometryAttribute::GENERIC, 1, draco::DT_UINT8, true, values, 2);
    for (uint32_t p = 0; p < vertex_of_point.size(); ++p) {
        positions->SetPointMapEntry(draco::PointIndex(p), draco::AttributeValueIndex(vertex_of_point[p]));
        marks->SetPointMapEntry(draco::PointIndex(p), draco::AttributeValueIndex(p >= input.vertex_count));
    }
    auto metadata = std::make_unique<draco::AttributeMetadata>();
    metadata->AddEntryString("name", "added_edges");
    mesh->AddAttributeMetadata(1, std::move(metadata));
    set_faces(mesh, points.data(), input.triangle_count);
}

// What the library's steps do to a coordinate, with its own arithmetic; of the step and the smallest
// coordinate the decoder above says the same.
double find_displacement(const qm_draco_input &input, const draco::PointAttribute &positions)
{
    draco::AttributeQuantizationTransform transform;
    if (!transform.ComputeParameters(positions, input.quantization_bits)) return INFINITY;
    const int32_t most = (1 << input.quantization_bits) - 1;
    const float step = transform.range() / static_cast<float>(most);
    draco::Quantizer quantizer;
    quantizer.Init(transform.range(), most);
    double largest = 0.0;
    for (size_t i = 0; i < input.vertex_count; ++i) {
        double square = 0.0;
        for (int axis = 0; axis < 3; ++axis) {
            const float given = input.positions[3 * i + static_cast<size_t>(axis)];
            const float low = transform.min_value(axis);
            const float decoded = static_cast<float>(quantizer.QuantizeFloat(given - low)) * step + low;
            const double off = double{decoded} - double{given};
            square += off * off;
        }
        largest = std::fmax(largest, square);
    }
    return std::sqrt(largest);
}

qm_draco_outcome encode(const qm_draco_input &input, qm_draco_write *write, void *user, double *displacement)
{
    draco::Mesh mesh;
    if (input.triangle_count > 0 && input.added) {
        fill_marked_mesh(input, &mesh);
    } else {
        fill_cloud(input, &mesh);
        set_faces(&mesh, input.triangles, input.triangle_count);
    }
    draco::Encoder encoder;
    encoder.SetSpeedOptions(5, 5);
    *displacement = 0.0;
    if (input.quantization_bits > 0) {
        encoder.SetAttributeQuantization(draco::GeometryAttribute::POSITION, input.quantization_bits);
        *displacement = find_displacement(input, *mesh.attribute(0));
    }
    draco::EncoderBuffer buffer;
    draco::Status status;
    if (input.triangle_count == 0) {
        encoder.SetEncodingMethod(draco::POINT_CLOUD_SEQUENTIAL_ENCODING);
        status = encoder.EncodePointCloudToBuffer(mesh, &buffer);
    } else {
        encoder.SetEncodingMethod(input.keeps_all ? draco::MESH_SEQUENTIAL_ENCODING
                                                  : draco::MESH_EDGEBREAKER_ENCODING);
        status = encoder.EncodeMeshToBuffer(mesh, &buffer);
    }
    if (!status.ok() || !std::isfinite(*displacement)) return QM_DRACO_MALFORMED;
    return write(user, buffer.data(), buffer.size()) ? QM_DRACO_DONE : QM_DRACO_NO_MEMORY;
}

} // namespace

extern "C" qm_draco_outcome qm_draco_encode(const qm_draco_input *input, qm_draco_write *write, void *user,
                                            double *displacement)
{
    try {
        return encode(*input, write, user, displacement);
    } catch (const std::bad_alloc &) {
        return QM_DRACO_NO_MEMORY;
    } catch (...) {
        return QM_DRACO_MALFORMED;
    }
}

extern "C" qm_draco_outcome qm_draco_decode(const uint8_t *bytes, size_t size, qm_draco_prepare *prepare,
                                            void *user, size_t *consumed)
{
    draco::DecoderBuffer buffer;
    *consumed = 0;
    try {
        Geometry geometry;
        buffer.Init(reinterpret_cast<const char *>(bytes), size);
        const bool decoded = decode_geometry(&buffer, &geometry);
        *consumed = size - static_cast<size_t>(buffer.remaining_size());
        return decoded ? take_apart(geometry, prepare, user) : QM_DRACO_MALFORMED;
    } catch (const std::bad_alloc &) {
        return QM_DRACO_NO_MEMORY;
    } catch (...) {
        return QM_DRACO_MALFORMED;
    }
}
