//! The same networks as an ONNX model, run by onnxruntime if its library is given.

use crate::protobuf::Message;
use ort::environment::Environment;
use ort::session::Session;
use ort::session::builder::GraphOptimizationLevel;
use ort::value::Tensor;
use retarget::Dense;

/// Environment variable that names the shared library.
const LIBRARY: &str = "ORT_DYLIB_PATH";

/// Loads the library. Prints a line if there is none.
pub(crate) fn library() -> Option<Environment> {
    let loaded = std::env::var(LIBRARY).map_err(|_| String::new()).and_then(|path| {
        let builder = ort::init_from(path).map_err(|error| format!(" ({error})"))?;
        builder.build().map_err(|error| format!(" ({error})"))
    });
    loaded.map_err(|reason| println!("onnxruntime: not found, set {LIBRARY}{reason}\n")).ok()
}

/// Creates a runtime with one thread and all optimisations.
pub(crate) fn runtime(
    library: &Environment,
    networks: &[Vec<Dense>],
    input: &[f32],
    batch: usize,
) -> impl FnMut() -> Vec<f32> + use<> {
    let mut session = Session::builder(library)
        .and_then(|builder| Ok(builder.with_optimization_level(GraphOptimizationLevel::All)?))
        .and_then(|builder| Ok(builder.with_intra_threads(1)?))
        .and_then(|builder| Ok(builder.with_inter_threads(1)?))
        .and_then(|mut builder| builder.commit_from_memory(&model(networks, batch)))
        .expect("onnxruntime accepts the model");
    let tensor = Tensor::from_array(([batch, input.len() / batch], input.to_vec())).expect("the input has its shape");
    move || {
        let outputs = session.run(ort::inputs![&tensor]).expect("onnxruntime runs the model");
        outputs[0].try_extract_tensor::<f32>().expect("the output is f32").1.to_vec()
    }
}

/// Builds a ModelProto: Gemm, and for hidden layers Sigmoid and Mul. Field numbers of onnx.proto3, opset 17.
fn model(networks: &[Vec<Dense>], batch: usize) -> Vec<u8> {
    let mut graph = Message::default();
    let mut last = "x".to_owned();
    let mut count = 0;
    for layers in networks {
        for (i, layer) in layers.iter().enumerate() {
            let (weight, bias, sum) = (format!("w{count}"), format!("b{count}"), format!("y{count}"));
            let transposed = Message::default().text(1, "transB").number(3, 1).number(20, 2);
            graph = graph
                .message(5, tensor(&weight, &[layer.outputs, layer.inputs], &layer.weight))
                .message(5, tensor(&bias, &[layer.outputs], &layer.bias))
                .message(1, node("Gemm", &[&last, &weight, &bias], &sum).message(5, transposed));
            last = sum;
            if i + 1 < layers.len() {
                let (sigmoid, product) = (format!("s{count}"), format!("z{count}"));
                graph = graph
                    .message(1, node("Sigmoid", &[&last], &sigmoid))
                    .message(1, node("Mul", &[&last, &sigmoid], &product));
                last = product;
            }
            count += 1;
        }
    }
    let (first, end) = (&networks[0][0], networks.iter().flatten().last().expect("a layer"));
    let graph = graph
        .text(2, "networks")
        .message(11, value("x", &[batch, first.inputs]))
        .message(12, value(&last, &[batch, end.outputs]));
    Message::default().number(1, 8).message(7, graph).message(8, Message::default().number(2, 17)).0
}

fn node(operator: &str, inputs: &[&str], output: &str) -> Message {
    let node = inputs.iter().fold(Message::default(), |node, input| node.text(1, input));
    node.text(2, output).text(4, operator)
}

fn tensor(name: &str, shape: &[usize], values: &[f32]) -> Message {
    let tensor = shape.iter().fold(Message::default(), |tensor, size| tensor.number(1, *size as u64));
    let bytes: Vec<u8> = values.iter().flat_map(|value| value.to_le_bytes()).collect();
    tensor.number(2, 1).text(8, name).bytes(9, &bytes)
}

fn value(name: &str, shape: &[usize]) -> Message {
    let shape = shape
        .iter()
        .fold(Message::default(), |shape, size| shape.message(1, Message::default().number(1, *size as u64)));
    let kind = Message::default().message(1, Message::default().number(1, 1).message(2, shape));
    Message::default().text(1, name).message(2, kind)
}
