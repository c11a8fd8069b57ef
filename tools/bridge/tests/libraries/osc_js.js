const OSC = require('osc-js');
const all = JSON.parse(require('fs').readFileSync(0, 'utf8'));
const bundle = new OSC.Bundle(all.map(([address, values]) => new OSC.Message(address, ...values)));
console.log(Buffer.from(bundle.pack()).toString('hex'));
