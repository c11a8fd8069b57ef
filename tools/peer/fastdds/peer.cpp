// A TIAGo++ on ROS 2 Humble over Fast DDS, played without ROS. See README.md in the folder above.

#include <fastdds/dds/domain/DomainParticipantFactory.hpp>
#include <fastdds/dds/domain/DomainParticipant.hpp>
#include <fastdds/dds/publisher/DataWriter.hpp>
#include <fastdds/dds/publisher/Publisher.hpp>
#include <fastdds/dds/subscriber/DataReader.hpp>
#include <fastdds/dds/subscriber/SampleInfo.hpp>
#include <fastdds/dds/subscriber/Subscriber.hpp>
#include <fastdds/rtps/transport/UDPv4TransportDescriptor.h>

#include <poll.h>
#include <unistd.h>
#include <algorithm>
#include <chrono>
#include <cmath>
#include <cstdio>
#include <fstream>
#include <iostream>
#include <map>
#include <memory>
#include <sstream>
#include <string>
#include <thread>
#include <vector>

#include "robotPubSubTypes.h"

using namespace eprosima::fastdds::dds;
using std::string;
using std::vector;
using State = control_msgs::msg::dds_::JointTrajectoryControllerState_;
using Trajectory = trajectory_msgs::msg::dds_::JointTrajectory_;
using Point = trajectory_msgs::msg::dds_::JointTrajectoryPoint_;

constexpr long NS_PER_S = 1000000000;
constexpr int UPDATE_HZ = 100, STATE_HZ = 50, EMERGENCY_HZ = 1;

[[noreturn]] void fail(const string& why) {
    std::cerr << "peer: " << why << std::endl;
    std::exit(1);
}

string text_of(const string& path) {
    std::ifstream file(path);
    if (!file) fail("cannot read " + path);
    std::stringstream text;
    text << file.rdbuf();
    return text.str();
}

// What a robot file says: its controllers in order with their joints, and where each joint is at home (rad, m).
struct Robot {
    vector<std::pair<string, vector<string>>> controllers;
    std::map<string, double> home;

    // Reads the few forms of TOML that a robot file has. A list of strings may span lines.
    explicit Robot(const string& path) {
        std::stringstream lines(text_of(path));
        string line, table;
        bool in_joints = false;
        while (std::getline(lines, line)) {
            line = line.substr(0, line.find('#'));
            if (line.rfind('[', 0) == 0) {
                table = line.substr(0, line.rfind(']') + 1);
                if (table == "[[controllers]]") controllers.emplace_back();
            }
            const auto key = line.substr(0, line.find_first_of(" ="));
            if (table == "[[controllers]]") {
                if (key == "name") controllers.back().first = quoted(line).at(0);
                in_joints = in_joints || key == "joints";
                if (in_joints) for (const auto& joint : quoted(line)) controllers.back().second.push_back(joint);
                in_joints = in_joints && line.find(']') == string::npos;
            } else if ((table == "[home_m]" || table == "[home_rad]") && line.find('=') != string::npos) {
                home[key] = std::stod(line.substr(line.find('=') + 1));
            }
        }
        if (controllers.empty()) fail(path + " has no [[controllers]]");
    }

    static vector<string> quoted(const string& line) {
        vector<string> found;
        for (size_t at = line.find('"'); at != string::npos;) {
            const size_t end = line.find('"', at + 1);
            found.push_back(line.substr(at + 1, end - at - 1));
            at = end == string::npos ? end : line.find('"', end + 1);
        }
        return found;
    }
};

long now_ns() {
    return std::chrono::duration_cast<std::chrono::nanoseconds>(std::chrono::system_clock::now().time_since_epoch()).count();
}

template <typename Time> long ns_of(const Time& time) { return time.sec() * NS_PER_S + time.nanosec(); }

void set_stamp(std_msgs::msg::dds_::Header_& header, long ns) {
    header.stamp().sec(static_cast<int32_t>(ns / NS_PER_S));
    header.stamp().nanosec(static_cast<uint32_t>(ns % NS_PER_S));
}

// One trajectory controller: the newest curve, where it is, and what the messages were like.
struct Controller {
    string name;
    vector<string> joints;
    vector<double> position, velocity;
    Trajectory curve;
    DataReader* commands = nullptr;
    DataWriter* states = nullptr;
    long messages = 0, points_min = 0, points_max = 0, last_ns = 0, gap_max_ns = 0;
    double step_max = 0.0;
    bool increasing = true, rests = true, complete = true;

    void take() {
        Trajectory message;
        SampleInfo info;
        while (commands->take_next_sample(&message, &info) == ReturnCode_t::RETCODE_OK) {
            if (!info.valid_data) continue;
            const auto& points = message.points();
            const long count = static_cast<long>(points.size()), now = now_ns();
            bool whole = count > 0 && message.joint_names() == joints;
            for (const auto& point : points)
                whole = whole && point.positions().size() == joints.size() && point.velocities().size() == joints.size();
            complete = complete && whole;
            if (!whole) continue;
            for (long i = 1; i < count; ++i)
                increasing = increasing && ns_of(points[i].time_from_start()) > ns_of(points[i - 1].time_from_start());
            for (double speed : points.back().velocities()) rests = rests && speed == 0.0;
            points_min = messages ? std::min(points_min, count) : count;
            points_max = std::max(points_max, count);
            if (messages++) gap_max_ns = std::max(gap_max_ns, now - last_ns);
            last_ns = now;
            curve = message;
        }
    }

    // Reads the cubic through the positions and velocities of the two points around `at_ns`.
    void update(long at_ns) {
        const auto& points = curve.points();
        if (points.empty()) return;
        const long t = at_ns - ns_of(curve.header().stamp());
        const auto after = std::find_if(points.begin(), points.end(), [t](const Point& p) { return ns_of(p.time_from_start()) > t; });
        if (after == points.begin()) return;
        for (size_t j = 0; j < joints.size(); ++j) {
            double q = points.back().positions()[j], v = 0.0;
            if (after != points.end()) {
                const Point &a = *(after - 1), &b = *after;
                const double h = 1e-9 * (ns_of(b.time_from_start()) - ns_of(a.time_from_start()));
                const double s = 1e-9 * (t - ns_of(a.time_from_start())) / h;
                const double d = b.positions()[j] - a.positions()[j], v0 = h * a.velocities()[j], v1 = h * b.velocities()[j];
                q = a.positions()[j] + s * (v0 + s * (3 * d - 2 * v0 - v1 + s * (v0 + v1 - 2 * d)));
                v = (v0 + s * (2 * (3 * d - 2 * v0 - v1) + s * 3 * (v0 + v1 - 2 * d))) / h;
            }
            step_max = std::max(step_max, std::abs(q - position[j]));
            position[j] = q;
            velocity[j] = v;
        }
    }

    void publish(long at_ns) const {
        State state;
        set_stamp(state.header(), at_ns);
        state.joint_names(joints);
        state.reference().positions(position);
        state.reference().velocities(velocity);
        state.feedback().positions(position);
        state.error().positions(vector<double>(joints.size(), 0.0));
        state.output().positions(position);
        states->write(&state);
    }

    string report() const {
        char text[400];
        std::snprintf(text, sizeof text, "\"%s\":{\"messages\":%ld,\"points\":[%ld,%ld],\"step_max\":%.6f,\"gap_max_ms\":%.1f,"
                      "\"increasing\":%s,\"rests\":%s,\"complete\":%s}", name.c_str(), messages, points_min, points_max, step_max,
                      1e-6 * gap_max_ns, increasing ? "true" : "false", rests ? "true" : "false", complete ? "true" : "false");
        return text;
    }
};

// Endpoints with the qualities of service that rmw_fastrtps gives a node of ROS 2 Humble.
struct Wire {
    DomainParticipant* participant;
    Publisher* publisher;
    Subscriber* subscriber;

    Wire(int domain, const string& address) {
        DomainParticipantQos qos;
        if (!address.empty()) {
            auto udp = std::make_shared<eprosima::fastdds::rtps::UDPv4TransportDescriptor>();
            udp->interfaceWhiteList.push_back(address);
            qos.transport().user_transports.push_back(udp);
            qos.transport().use_builtin_transports = false;
        }
        participant = DomainParticipantFactory::get_instance()->create_participant(domain, qos);
        if (!participant) fail("no participant");
        publisher = participant->create_publisher(PUBLISHER_QOS_DEFAULT);
        subscriber = participant->create_subscriber(SUBSCRIBER_QOS_DEFAULT);
    }

    template <typename Type> Topic* topic(const string& name) {
        TypeSupport type(new Type());
        type.register_type(participant);
        return participant->create_topic("rt/" + name, type.get_type_name(), TOPIC_QOS_DEFAULT);
    }

    template <typename Type> DataWriter* writer(const string& name, bool latched = false) {
        DataWriterQos qos;
        qos.endpoint().history_memory_policy = eprosima::fastrtps::rtps::PREALLOCATED_WITH_REALLOC_MEMORY_MODE;
        qos.data_sharing().off();
        qos.reliability().kind = RELIABLE_RELIABILITY_QOS;
        qos.durability().kind = latched ? TRANSIENT_LOCAL_DURABILITY_QOS : VOLATILE_DURABILITY_QOS;
        qos.history().depth = 1;
        return publisher->create_datawriter(topic<Type>(name), qos);
    }

    template <typename Type> DataReader* reader(const string& name, bool best_effort) {
        DataReaderQos qos;
        qos.endpoint().history_memory_policy = eprosima::fastrtps::rtps::PREALLOCATED_WITH_REALLOC_MEMORY_MODE;
        qos.data_sharing().off();
        qos.reliability().kind = best_effort ? BEST_EFFORT_RELIABILITY_QOS : RELIABLE_RELIABILITY_QOS;
        // A controller takes each message when it arrives. This reader looks once for each update.
        qos.history().depth = 16;
        return subscriber->create_datareader(topic<Type>(name), qos);
    }
};

int main(int count, char** words) {
    std::map<string, string> options{{"--domain", "0"}, {"--address", ""}, {"--description-bytes", "0"}, {"--reliability", "best-effort"}};
    for (int i = 1; i + 1 < count; i += 2) options[words[i]] = words[i + 1];
    if (!options.count("--robot") || !options.count("--urdf"))
        fail("--robot FILE --urdf FILE [--domain N] [--address IP] [--reliability best-effort|reliable] [--description-bytes N]");
    const Robot robot(options["--robot"]);
    Wire wire(std::stoi(options["--domain"]), options["--address"]);

    vector<Controller> controllers;
    for (const auto& [name, joints] : robot.controllers) {
        Controller one;
        one.name = name;
        one.joints = joints;
        for (const auto& joint : joints) one.position.push_back(robot.home.at(joint));
        one.velocity.assign(joints.size(), 0.0);
        one.commands = wire.reader<trajectory_msgs::msg::dds_::JointTrajectory_PubSubType>(
            name + "/joint_trajectory", options["--reliability"] == "best-effort");
        one.states = wire.writer<control_msgs::msg::dds_::JointTrajectoryControllerState_PubSubType>(name + "/controller_state");
        controllers.push_back(one);
    }
    auto* joint_states = wire.writer<sensor_msgs::msg::dds_::JointState_PubSubType>("joint_states");
    auto* emergency = wire.writer<std_msgs::msg::dds_::Bool_PubSubType>("power/is_emergency");
    auto* description = wire.writer<std_msgs::msg::dds_::String_PubSubType>("robot_description", true);
    std_msgs::msg::dds_::String_ urdf;
    urdf.data(text_of(options["--urdf"]));
    if (const size_t bytes = std::stoul(options["--description-bytes"]); bytes > urdf.data().size())
        urdf.data().insert(urdf.data().rfind('<'), string(bytes - urdf.data().size(), ' '));
    description->write(&urdf);
    std::cout << "ready" << std::endl;

    // The end of the standard input ends it.
    pollfd input{STDIN_FILENO, POLLIN, 0};
    char thrown_away[64];
    const auto begin = std::chrono::steady_clock::now();
    for (long tick = 0; !(poll(&input, 1, 0) > 0 && read(STDIN_FILENO, thrown_away, sizeof thrown_away) <= 0); ++tick) {
        std::this_thread::sleep_until(begin + std::chrono::microseconds(1000000 / UPDATE_HZ) * tick);
        const long now = now_ns();
        for (auto& one : controllers) {
            one.take();
            one.update(now);
        }
        if (tick % (UPDATE_HZ / STATE_HZ) == 0) {
            sensor_msgs::msg::dds_::JointState_ state;
            set_stamp(state.header(), now);
            for (const auto& one : controllers) {
                one.publish(now);
                state.name().insert(state.name().end(), one.joints.begin(), one.joints.end());
                state.position().insert(state.position().end(), one.position.begin(), one.position.end());
                state.velocity().insert(state.velocity().end(), one.velocity.begin(), one.velocity.end());
            }
            state.effort(vector<double>(state.name().size(), 0.0));
            joint_states->write(&state);
        }
        if (tick % (UPDATE_HZ / EMERGENCY_HZ) == 0) {
            std_msgs::msg::dds_::Bool_ released;
            released.data(false);
            emergency->write(&released);
        }
    }
    string report = "{";
    for (const auto& one : controllers) report += (report.size() > 1 ? "," : "") + one.report();
    std::cout << report << "}" << std::endl;
    // Leaves the domain at once, as a node that is shut down.
    wire.participant->delete_contained_entities();
    DomainParticipantFactory::get_instance()->delete_participant(wire.participant);
}
