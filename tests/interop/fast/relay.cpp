// A peer that relays raw CDR between its standard streams and Fast DDS, with requests in the form of rmw_fastrtps.
//
//     client NAME REQUEST_TOPIC REQUEST_TYPE REPLY_TOPIC RESPONSE_TYPE
//     call NAME NUMBER HEX                 a request; HEX begins with the encapsulation header
//     reader NAME TOPIC TYPE RELIABILITY DURABILITY
//     writer NAME TOPIC TYPE RELIABILITY DURABILITY
//     write NAME HEX
//
// It answers with `matched NAME` when the other side has been found, `reply NAME NUMBER HEX`, `sample NAME HEX`,
// `again NAME NUMBER` for a reply that came before, and `stray NAME` for one that answers no request of this client. It
// leaves at the end of its input.

#include <fastdds/dds/domain/DomainParticipant.hpp>
#include <fastdds/dds/domain/DomainParticipantFactory.hpp>
#include <fastdds/dds/publisher/DataWriter.hpp>
#include <fastdds/dds/publisher/Publisher.hpp>
#include <fastdds/dds/subscriber/DataReader.hpp>
#include <fastdds/dds/subscriber/SampleInfo.hpp>
#include <fastdds/dds/subscriber/Subscriber.hpp>
#include <fastdds/dds/topic/Topic.hpp>
#include <fastdds/dds/topic/TopicDataType.hpp>
#include <fastdds/rtps/common/WriteParams.h>

#include <poll.h>
#include <unistd.h>

#include <cstdint>
#include <cstdlib>
#include <cstring>
#include <iostream>
#include <map>
#include <memory>
#include <sstream>
#include <string>
#include <vector>

namespace fast = eprosima::fastdds::dds;
namespace rtps = eprosima::fastrtps::rtps;

using Bytes = std::vector<uint8_t>;

static void fail(const std::string& reason) {
    std::cerr << reason << std::endl;
    std::exit(1);
}

static std::string to_hex(const Bytes& bytes) {
    static const char digits[] = "0123456789abcdef";
    std::string text;
    for (uint8_t byte : bytes) {
        text += digits[byte >> 4];
        text += digits[byte & 15];
    }
    return text;
}

static Bytes from_hex(const std::string& text) {
    Bytes bytes;
    for (size_t at = 0; at + 2 <= text.size(); at += 2) {
        bytes.push_back(static_cast<uint8_t>(std::stoul(text.substr(at, 2), nullptr, 16)));
    }
    return bytes;
}

// A type of any name whose samples are bytes, encapsulation header included.
struct RawType : fast::TopicDataType {
    explicit RawType(const std::string& name) {
        setName(name.c_str());
        m_typeSize = 65'000;
        auto_fill_type_object(false);
        auto_fill_type_information(false);
    }
    bool serialize(void* data, rtps::SerializedPayload_t* payload) override {
        const Bytes& bytes = *static_cast<Bytes*>(data);
        if (bytes.size() > payload->max_size) {
            return false;
        }
        payload->encapsulation = CDR_LE;
        payload->length = static_cast<uint32_t>(bytes.size());
        std::memcpy(payload->data, bytes.data(), bytes.size());
        return true;
    }
    bool deserialize(rtps::SerializedPayload_t* payload, void* data) override {
        static_cast<Bytes*>(data)->assign(payload->data, payload->data + payload->length);
        return true;
    }
    std::function<uint32_t()> getSerializedSizeProvider(void* data) override {
        return [data] { return static_cast<uint32_t>(static_cast<Bytes*>(data)->size()); };
    }
    void* createData() override { return new Bytes; }
    void deleteData(void* data) override { delete static_cast<Bytes*>(data); }
    bool getKey(void*, rtps::InstanceHandle_t*, bool) override { return false; }
};

// One reader, one writer, or the two of a client.
struct End {
    fast::DataReader* reader = nullptr;
    fast::DataWriter* writer = nullptr;
    bool matched = false;
    std::map<int64_t, std::string> open, answered;  // sequence number of the request -> the caller's number
};

class Peer {
public:
    explicit Peer(uint32_t domain) {
        auto* factory = fast::DomainParticipantFactory::get_instance();
        participant_ = factory->create_participant(domain, fast::PARTICIPANT_QOS_DEFAULT);
        if (!participant_) {
            fail("cannot join the domain");
        }
        publisher_ = participant_->create_publisher(fast::PUBLISHER_QOS_DEFAULT);
        subscriber_ = participant_->create_subscriber(fast::SUBSCRIBER_QOS_DEFAULT);
    }

    ~Peer() {
        participant_->delete_contained_entities();
        fast::DomainParticipantFactory::get_instance()->delete_participant(participant_);
    }

    void obey(const std::string& line) {
        std::istringstream words(line);
        std::string command, name, a, b, c, d;
        words >> command >> name >> a >> b >> c >> d;
        End& end = ends_[name];
        if (command == "client") {
            open_writer(end, a, b, "reliable", "volatile");
            open_reader(end, c, d, "reliable", "volatile");
        } else if (command == "reader") {
            open_reader(end, a, b, c, d);
        } else if (command == "writer") {
            open_writer(end, a, b, c, d);
        } else if (command == "call") {
            // As rmw_fastrtps: the request names the client's reply reader, and its number is the sample's own.
            rtps::WriteParams params;
            params.related_sample_identity().writer_guid() = end.reader->guid();
            write(end, from_hex(b), params);
            end.open[params.sample_identity().sequence_number().to64long()] = a;
        } else if (command == "write") {
            rtps::WriteParams params;
            write(end, from_hex(a), params);
        } else {
            fail("no such command: " + line);
        }
    }

    // Says what has been found and received since the last call.
    void report() {
        for (auto& [name, end] : ends_) {
            if (!end.matched && is_matched(end)) {
                end.matched = true;
                std::cout << "matched " << name << std::endl;
            }
            if (end.reader) {
                receive(name, end);
            }
        }
    }

private:
    static bool is_matched(End& end) {
        fast::SubscriptionMatchedStatus subscription;
        fast::PublicationMatchedStatus publication;
        if (end.reader) {
            end.reader->get_subscription_matched_status(subscription);
        }
        if (end.writer) {
            end.writer->get_publication_matched_status(publication);
        }
        return (!end.reader || subscription.current_count > 0) && (!end.writer || publication.current_count > 0);
    }

    static void receive(const std::string& name, End& end) {
        Bytes bytes;
        fast::SampleInfo info;
        while (end.reader->take_next_sample(&bytes, &info) == ReturnCode_t::RETCODE_OK) {
            if (!info.valid_data) {
                continue;
            }
            if (!end.writer) {
                std::cout << "sample " << name << ' ' << to_hex(bytes) << std::endl;
                continue;
            }
            // As rmw_fastrtps: a reply names the request by the client's reader, or its writer, and the number.
            const auto& related = info.related_sample_identity;
            auto request = end.open.find(related.sequence_number().to64long());
            bool mine = related.writer_guid() == end.reader->guid() || related.writer_guid() == end.writer->guid();
            auto before = end.answered.find(related.sequence_number().to64long());
            if (mine && before != end.answered.end()) {
                std::cout << "again " << name << ' ' << before->second << std::endl;
                continue;
            }
            if (!mine || request == end.open.end()) {
                std::cout << "stray " << name << std::endl;
                continue;
            }
            std::cout << "reply " << name << ' ' << request->second << ' ' << to_hex(bytes) << std::endl;
            end.answered.insert(*request);
            end.open.erase(request);
        }
    }

    static void write(End& end, Bytes bytes, rtps::WriteParams& params) {
        if (!end.writer || !end.writer->write(&bytes, params)) {
            fail("cannot write");
        }
    }

    fast::Topic* topic(const std::string& name, const std::string& type) {
        if (auto* known = dynamic_cast<fast::Topic*>(participant_->lookup_topicdescription(name))) {
            return known;
        }
        fast::TypeSupport(new RawType(type)).register_type(participant_);
        return participant_->create_topic(name, type, fast::TOPIC_QOS_DEFAULT);
    }

    template <class Qos>
    static Qos with(Qos qos, const std::string& reliability, const std::string& durability) {
        bool reliable = reliability == "reliable", latched = durability == "latched";
        qos.reliability().kind = reliable ? fast::RELIABLE_RELIABILITY_QOS : fast::BEST_EFFORT_RELIABILITY_QOS;
        qos.durability().kind = latched ? fast::TRANSIENT_LOCAL_DURABILITY_QOS : fast::VOLATILE_DURABILITY_QOS;
        qos.history().kind = fast::KEEP_LAST_HISTORY_QOS;
        qos.history().depth = 10;
        qos.endpoint().history_memory_policy = rtps::PREALLOCATED_WITH_REALLOC_MEMORY_MODE;
        qos.data_sharing().off();
        return qos;
    }

    void open_reader(End& end, const std::string& name, const std::string& type, const std::string& reliability,
                     const std::string& durability) {
        auto qos = with(fast::DATAREADER_QOS_DEFAULT, reliability, durability);
        end.reader = subscriber_->create_datareader(topic(name, type), qos);
        if (!end.reader) {
            fail("cannot read " + name);
        }
    }

    void open_writer(End& end, const std::string& name, const std::string& type, const std::string& reliability,
                     const std::string& durability) {
        auto qos = with(fast::DATAWRITER_QOS_DEFAULT, reliability, durability);
        // Large bodies leave in fragments, which only a writer with a thread of its own can send.
        qos.publish_mode().kind = fast::PublishModeQosPolicyKind_t::ASYNCHRONOUS_PUBLISH_MODE;
        end.writer = publisher_->create_datawriter(topic(name, type), qos);
        if (!end.writer) {
            fail("cannot write " + name);
        }
    }

    fast::DomainParticipant* participant_;
    fast::Publisher* publisher_;
    fast::Subscriber* subscriber_;
    std::map<std::string, End> ends_;
};

int main(int count, char** arguments) {
    if (count != 2) {
        fail("usage: relay DOMAIN");
    }
    Peer peer(static_cast<uint32_t>(std::stoul(arguments[1])));
    std::string input;
    for (;;) {
        pollfd ready{STDIN_FILENO, POLLIN, 0};
        // Woken by a command, else every millisecond for what has come over the network.
        if (poll(&ready, 1, 1) > 0) {
            char chunk[65536];
            ssize_t length = read(STDIN_FILENO, chunk, sizeof chunk);
            if (length <= 0) {
                return 0;
            }
            input.append(chunk, static_cast<size_t>(length));
            for (size_t end; (end = input.find('\n')) != std::string::npos; input.erase(0, end + 1)) {
                peer.obey(input.substr(0, end));
            }
        }
        peer.report();
    }
}
