<!DOCTYPE qgis PUBLIC 'http://mrcc.com/qgis.dtd' 'SYSTEM'>
<!-- Ground worked twice: red. -->
<qgis version="3.34.0" styleCategories="Symbology|MapTips|Temporal">
 <temporal enabled="1" mode="1" startField="end" endField="" startExpression="" endExpression="" durationField="" durationUnit="ms" fixedDuration="0" limitMode="0" accumulate="1">
  <fixedRange>
   <start></start>
   <end></end>
  </fixedRange>
 </temporal>
 <renderer-v2 type="singleSymbol" enableorderby="0" forceraster="0" symbollevels="0" referencescale="-1">
  <symbols>
   <symbol type="fill" name="0" alpha="1" clip_to_extent="1" force_rhr="0">
    <layer class="SimpleFill" enabled="1" locked="0" pass="0">
     <Option type="Map">
      <Option name="color" type="QString" value="194,81,0,220"/>
      <Option name="style" type="QString" value="solid"/>
      <Option name="outline_color" type="QString" value="194,81,0,255"/>
      <Option name="outline_style" type="QString" value="solid"/>
      <Option name="outline_width" type="QString" value="0.3"/>
      <Option name="outline_width_unit" type="QString" value="MM"/>
     </Option>
    </layer>
   </symbol>
  </symbols>
 </renderer-v2>
 <mapTip enabled="1">&lt;b&gt;overlap&lt;/b&gt; of pass [% "pass_a" %] and pass [% "pass_b" %]&lt;br&gt;[% coalesce(format_number("area_m2", max(0, 1 - floor(log10(2 * "area_sigma_m2")))) || ' ± ' || format_number(round(2 * "area_sigma_m2", 1 - floor(log10(2 * "area_sigma_m2"))), max(0, 1 - floor(log10(2 * "area_sigma_m2")))) || ' m² (95 %)', format_number("area_m2", 1) || ' m²') %]</mapTip>
</qgis>
